// SPDX-License-Identifier: Apache-2.0
#include "core/camera.h"

namespace stillmap {

namespace {

Vec2 distorted(const CameraModel& c, double x, double y) {
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
  return {x * radial + 2 * c.p1 * x * y + c.p2 * (r2 + 2 * x * x),
          y * radial + c.p1 * (r2 + 2 * y * y) + 2 * c.p2 * x * y};
}

}  // namespace

Vec2 CameraModel::project(Vec3 p) const {
  const Vec2 d = distorted(*this, p.x / p.z, p.y / p.z);
  return {fx * d.x + cx, fy * d.y + cy};
}

Vec2 CameraModel::undistort(Vec2 pixel) const {
  const double u = (pixel.x - cx) / fx, v = (pixel.y - cy) / fy;
  // Fixed-point iteration on the distortion's offset. It contracts for every lens whose picture does not fold
  // over itself; 20 rounds leave less than 1e-6 px on the benchmark cameras, corners included.
  double x = u, y = v;
  for (int i = 0; i < 20; ++i) {
    const Vec2 d = distorted(*this, x, y);
    x += u - d.x;
    y += v - d.y;
  }
  return {x, y};
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
