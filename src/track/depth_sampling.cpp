// SPDX-License-Identifier: Apache-2.0
#include "track/depth_sampling.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace stillmap {

namespace {

/// Depth of the nearer surface in the 3x3 pixels around `pixel`; 0 where fewer than four of them have a
/// reading.
double nearer_depth(ImageView<const std::uint16_t> depth, const CameraModel& camera, Vec2 pixel) {
  const bool inside =
      pixel.x >= 0.5 && pixel.y >= 0.5 && pixel.x < depth.width - 1.5 && pixel.y < depth.height - 1.5;
  if (!inside) return 0;
  const int x = static_cast<int>(std::lround(pixel.x)), y = static_cast<int>(std::lround(pixel.y));
  std::array<double, 9> readings;
  std::size_t count = 0;
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      const double z = camera.depth_m(depth.at(x + dx, y + dy));
      if (z > 0) readings[count++] = z;
    }
  }
  if (count < 4) return 0;
  std::sort(readings.begin(), readings.begin() + static_cast<std::ptrdiff_t>(count));
  constexpr double kSplitShare = 0.04;  // a larger jump is an edge between two surfaces
  for (std::size_t i = 1; i < count; ++i) {
    if (readings[i] - readings[i - 1] > kSplitShare * readings[i - 1]) {
      return i >= 2 ? readings[i / 2] : 0;
    }
  }
  return readings[count / 2];
}

}  // namespace

std::optional<Vec2> depth_pixel(const CameraModel& camera, const Pose& T_depth_colour,
                                const Feature& feature) {
  const Vec3 turned = T_depth_colour.R * Vec3{feature.ray_x, feature.ray_y, 1};
  if (turned.z <= 0) return std::nullopt;
  const Vec2 pixel = camera.project(turned);
  // Before anything is rounded: a ray that nearly leaves the picture plane may be anywhere, or nowhere.
  const bool inside =
      pixel.x >= 0 && pixel.y >= 0 && pixel.x <= camera.width - 1 && pixel.y <= camera.height - 1;
  return inside ? std::optional(pixel) : std::nullopt;
}

void sample_depth(ImageView<const std::uint16_t> depth, const CameraModel& camera, const Pose& T_depth_colour,
                  std::span<Feature> features) {
  const Pose T_colour_depth = inverse(T_depth_colour);
  for (Feature& f : features) {
    f.depth_m = 0;
    const std::optional<Vec2> pixel = depth_pixel(camera, T_depth_colour, f);
    if (!pixel) continue;
    const double z = nearer_depth(depth, camera, *pixel);
    if (z <= 0) continue;
    const Vec3 turned = T_depth_colour.R * Vec3{f.ray_x, f.ray_y, 1};
    const Vec3 p_depth = {turned.x / turned.z * z, turned.y / turned.z * z, z};
    f.depth_m = static_cast<float>((T_colour_depth * p_depth).z);
  }
}

}  // namespace stillmap
