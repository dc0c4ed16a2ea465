// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bit>
#include <cstdint>

#include "core/dynamic_mask.h"
#include "core/geometry.h"

namespace stillmap {

/// 256-bit oriented binary descriptor.
struct Descriptor {
  std::array<std::uint64_t, 4> bits{};
};
inline int hamming(const Descriptor& a, const Descriptor& b) {
  int distance = 0;
  for (std::size_t i = 0; i < 4; ++i) distance += std::popcount(a.bits[i] ^ b.bits[i]);
  return distance;
}

/// A corner of one frame.
struct Feature {
  float x = 0, y = 0;          ///< pixel as the lens shows it, at full resolution
  float ray_x = 0, ray_y = 0;  ///< undistorted ray (ray_x, ray_y, 1) in the camera frame
  float depth_m = 0;           ///< along the optical axis; 0 = no reading
  float angle_rad = 0;         ///< orientation of the patch (intensity centroid)
  float response = 0;
  std::uint8_t octave = 0;  ///< pyramid level it was found on
  Label label = Label::Unknown;
};

}  // namespace stillmap
