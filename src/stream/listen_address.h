// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/status.h"

namespace stillmap::stream {

struct ListenAddress {
  std::string host;  ///< numeric, without brackets
  bool ipv6 = false;
  int port = 0;  ///< 0: any free one
};

/// Reads ADDR:PORT or [ADDR]:PORT, with a numeric address.
Result<ListenAddress> parse_listen_address(const std::string& text);

/// Binds and lets go again, for the reason why it fails: the library that listens only says that it does.
Status check_can_listen(const ListenAddress& address);

}  // namespace stillmap::stream
