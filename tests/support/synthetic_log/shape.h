// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/geometry.h"
#include "tests/support/synthetic_log/texture.h"

namespace stillmap::synthetic {

/// World: z up, origin on the floor in the room's middle, metres.
enum class ShapeKind : std::uint8_t {
  Box,        ///< half = half edges
  Cylinder,   ///< along its z axis: half.x, half.y radii, half.z half length, flat ends
  Ellipsoid,  ///< half = semi-axes
  Capsule     ///< along its z axis: half.x, half.y radii, half.z half length without the round ends
};

struct Shape {
  ShapeKind kind = ShapeKind::Box;
  Vec3 center;
  Mat3 axes;  ///< R_world_shape
  Vec3 half{1, 1, 1};
  int material = 0;
  double texels_per_m = 400;  ///< flat faces; a round side shows its texture once round and once along
  double u_offset = 0, v_offset = 0;
  float tint = 1;
  std::uint8_t figure = 0;  ///< 0 = fixed, k = belongs to the k-th figure
};

/// The empty room around everything: |x| <= half_x, |y| <= half_y, 0 <= z <= height.
struct RoomShell {
  double half_x = 3, half_y = 3, height = 2.7;
  std::array<int, 4> walls{};  ///< materials of -x, +x, -y, +y
};

inline Mat3 yaw_rotation(double angle_rad) {
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  return {{c, -s, 0, s, c, 0, 0, 0, 1}};
}

inline Vec3 normalized(Vec3 v) {
  return (1 / norm(v)) * v;
}

/// A frame whose z axis is `z` and whose x axis is as near to `x` as that allows.
inline Mat3 frame_along(Vec3 z, Vec3 x) {
  const Vec3 c = normalized(z), b = normalized(cross(c, x)), a = cross(b, c);
  return {{a.x, b.x, c.x, a.y, b.y, c.y, a.z, b.z, c.z}};
}

}  // namespace stillmap::synthetic
