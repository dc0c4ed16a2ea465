// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace stillmap {

/// One point of the map as it goes onto the wire: 16 bytes, m in the map frame, colour 0..255, opaque at a =
/// 255.
struct CloudPoint {
  float x = 0, y = 0, z = 0;
  std::uint8_t r = 0, g = 0, b = 0, a = 255;
};
static_assert(sizeof(CloudPoint) == 16);

}  // namespace stillmap
