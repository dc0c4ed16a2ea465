// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#ifdef __ARM_NEON
#include <arm_neon.h>
#endif

#include "core/dynamic_mask.h"
#include "core/geometry.h"

namespace stillmap {

inline constexpr std::size_t kMaxFeatures = 1200;  ///< of one frame, and so of a keyframe

/// 256-bit oriented binary descriptor.
struct Descriptor {
  std::array<std::uint64_t, 4> bits{};
};
/// How many bits differ.
inline int hamming(const Descriptor& a, const Descriptor& b) {
#ifdef __ARM_NEON
  // ARM counts bits in vectors only; compilers take each word there and back.
  const auto differing = [&](std::size_t i) {
    return vcntq_u8(vreinterpretq_u8_u64(veorq_u64(vld1q_u64(&a.bits[i]), vld1q_u64(&b.bits[i]))));
  };
  const uint8x16_t counts = vaddq_u8(differing(0), differing(2));
#ifdef __aarch64__
  return vaddlvq_u8(counts);
#else
  const uint64x2_t halves = vpaddlq_u32(vpaddlq_u16(vpaddlq_u8(counts)));
  return static_cast<int>(vgetq_lane_u64(halves, 0) + vgetq_lane_u64(halves, 1));
#endif
#else
  int distance = 0;
  for (std::size_t i = 0; i < 4; ++i) distance += std::popcount(a.bits[i] ^ b.bits[i]);
  return distance;
#endif
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
