// SPDX-License-Identifier: Apache-2.0
#include "core/camera.h"

#include <cmath>

namespace stillmap {

namespace {

Vec2 distorted(const CameraModel& c, double x, double y) {
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
  return {x * radial + 2 * c.p1 * x * y + c.p2 * (r2 + 2 * x * x),
          y * radial + c.p1 * (r2 + 2 * y * y) + 2 * c.p2 * x * y};
}

/// Whether the lens shows a small square around the ray the right way round: the distortion's Jacobian.
bool keeps_orientation(const CameraModel& c, Vec2 ray) {
  constexpr double kSmall = 1e-5;
  const Vec2 left = distorted(c, ray.x - kSmall, ray.y), right = distorted(c, ray.x + kSmall, ray.y);
  const Vec2 up = distorted(c, ray.x, ray.y - kSmall), down = distorted(c, ray.x, ray.y + kSmall);
  return (right.x - left.x) * (down.y - up.y) - (right.y - left.y) * (down.x - up.x) > 0;
}

}  // namespace

Vec2 CameraModel::project(Vec3 p) const {
  const Vec2 d = distorted(*this, p.x / p.z, p.y / p.z);
  return {fx * d.x + cx, fy * d.y + cy};
}

Vec2 CameraModel::undistort(Vec2 pixel) const {
  const double u = (pixel.x - cx) / fx, v = (pixel.y - cy) / fy;
  // Fixed-point iteration on the distortion's offset. It contracts for every lens whose picture does not fold
  // over itself; 20 rounds leave less than 1e-6 px on the benchmark cameras, corners included, and a few do
  // elsewhere.
  constexpr double kSettled = 1e-9;
  double x = u, y = v;
  for (int i = 0; i < 20; ++i) {
    const Vec2 d = distorted(*this, x, y);
    x += u - d.x;
    y += v - d.y;
    if (std::abs(u - d.x) + std::abs(v - d.y) < kSettled) break;
  }
  return {x, y};
}

std::optional<Vec2> CameraModel::folded_pixel() const {
  constexpr int kStep = 8;
  constexpr double kMaxError_px = 0.01;
  const auto next = [](int v, int last) { return v < last && v + kStep > last ? last : v + kStep; };
  for (int y = 0; y < height; y = next(y, height - 1)) {
    for (int x = 0; x < width; x = next(x, width - 1)) {
      const Vec2 pixel{static_cast<double>(x), static_cast<double>(y)};
      const Vec2 ray = undistort(pixel);
      const Vec2 back = project({ray.x, ray.y, 1});
      const bool found =
          std::abs(back.x - pixel.x) < kMaxError_px && std::abs(back.y - pixel.y) < kMaxError_px;
      if (!found || !keeps_orientation(*this, ray)) return pixel;
    }
  }
  return std::nullopt;
}

RayTable::RayTable(Arena& arena, const CameraModel& camera)
    : rays_(arena.take<Ray>(
          "ray_table", static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height))),
      width_(static_cast<std::size_t>(camera.width)) {
  if (arena.planning()) return;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const Vec2 ray = camera.undistort({static_cast<double>(x), static_cast<double>(y)});
      rays_[static_cast<std::size_t>(y) * width_ + static_cast<std::size_t>(x)] = {static_cast<float>(ray.x),
                                                                                   static_cast<float>(ray.y)};
    }
  }
}

}  // namespace stillmap
