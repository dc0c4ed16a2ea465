// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "core/config.h"
#include "core/status.h"
#include "stream/listen_address.h"

namespace stillmap::stream {

/// What a request says of itself; empty where it says nothing.
struct RequestFacts {
  std::string_view host{}, origin{};
  std::string_view token{}, cookies{};  ///< of `?token=`; the whole Cookie header
};

/// Who may see the stream. Made at start; the checks are pure, for any thread, without heap.
///
/// Beyond loopback everyone needs a token. Without one (on loopback) a request must name this machine by
/// number or as localhost, so that no web page reaches it through a host name of its own ("DNS rebinding").
/// Of browsers, only pages of this server and of `stream.origins` may open the WebSocket; programs that are
/// no browser send no origin.
class Access {
 public:
  /// Reads the token file. The error names key, value and mend.
  static Result<Access> open(const Config::Stream& config, const ListenAddress& address);

  enum class Verdict { Welcome, WrongHost, WrongToken, WrongOrigin };
  /// `web_socket`: the origin counts.
  Verdict judge(const RequestFacts& request, bool web_socket) const;
  /// What keeps a browser that came with the token in its address logged in; empty without a token.
  const std::string& cookie() const { return cookie_; }

 private:
  bool has_token(const RequestFacts& request) const;

  std::string token_, cookie_;
  std::vector<std::string> origins_;
};

/// One line for whoever was turned away, with the mend.
const char* explain(Access::Verdict verdict);

/// Whether only this machine can reach the address.
bool is_loopback(const ListenAddress& address);

/// Whether they are equal, in a time that depends on the length of `expected` alone.
bool equal_in_constant_time(std::string_view given, std::string_view expected);

}  // namespace stillmap::stream
