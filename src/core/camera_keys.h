// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

namespace stillmap {

/// Whether one of these configuration files sets a key that every camera must have. False also for one that
/// cannot be read: load_config() says so.
bool describes_camera(std::span<const std::string> files);

}  // namespace stillmap
