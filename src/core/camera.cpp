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

/// Of `distorted` at a ray; symmetric.
struct Jacobian {
  double xx = 0, xy = 0, yy = 0;
  Jacobian(const CameraModel& c, double x, double y) {
    const double r2 = x * x + y * y;
    const double radial = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
    const double slope = 2 * (c.k1 + r2 * (2 * c.k2 + r2 * 3 * c.k3));  // of radial, by r2, twice
    xx = radial + slope * x * x + 2 * c.p1 * y + 6 * c.p2 * x;
    xy = slope * x * y + 2 * (c.p1 * x + c.p2 * y);
    yy = radial + slope * y * y + 6 * c.p1 * y + 2 * c.p2 * x;
  }
  double determinant() const { return xx * yy - xy * xy; }
};

}  // namespace

Vec2 CameraModel::project(Vec3 p) const {
  const Vec2 d = distorted(*this, p.x / p.z, p.y / p.z);
  return {fx * d.x + cx, fy * d.y + cy};
}

Vec2 CameraModel::undistort(Vec2 pixel) const {
  const double u = (pixel.x - cx) / fx, v = (pixel.y - cy) / fy;
  // Newton's method from the picture itself: two or three rounds for TUM's lenses, which bend much.
  constexpr int kMostRounds = 20;
  constexpr double kSettled = 1e-9;
  double x = u, y = v;
  for (int i = 0; i < kMostRounds; ++i) {
    const Vec2 d = distorted(*this, x, y);
    const double ex = u - d.x, ey = v - d.y;
    if (std::abs(ex) + std::abs(ey) < kSettled) break;
    const Jacobian j(*this, x, y);
    x += (j.yy * ex - j.xy * ey) / j.determinant();
    y += (j.xx * ey - j.xy * ex) / j.determinant();
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
      if (!found || Jacobian(*this, ray.x, ray.y).determinant() <= 0) return pixel;
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
