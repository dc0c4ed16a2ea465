// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_log/ray_caster.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap::synthetic {

namespace {

constexpr float kNearest_m = 0.05f;
constexpr float kNone = std::numeric_limits<float>::infinity();

/// The nearest root of a t^2 + 2 b t + c = 0 that lies in front of the camera.
float first_root(float a, float b, float c) {
  const float d = b * b - a * c;
  if (d <= 0) return kNone;
  const float t = (-b - std::sqrt(d)) / a;
  return t > kNearest_m ? t : kNone;
}

float half_length(const Shape& s) {
  return static_cast<float>(s.kind == ShapeKind::Capsule ? s.half.z + (s.half.x + s.half.y) / 2 : s.half.z);
}

}  // namespace

RayCaster::RayCaster(const CameraModel& camera, const RoomShell& room, const std::vector<Texture>& materials)
    : camera_(camera),
      room_(room),
      materials_(materials),
      columns_((camera.width + kTilePx - 1) / kTilePx),
      rows_((camera.height + kTilePx - 1) / kTilePx),
      tiles_(static_cast<std::size_t>(columns_ * rows_)) {}

void RayCaster::look(const Pose& T_world_camera, std::span<const Shape> shapes, double x_offset_px,
                     double y_offset_px) {
  const auto f3 = [](double x, double y, double z) {
    return F3{static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)};
  };
  T_world_camera_ = T_world_camera;
  const Mat3& R = T_world_camera.R;
  position_ = f3(T_world_camera.t.x, T_world_camera.t.y, T_world_camera.t.z);
  right_ = f3(R(0, 0), R(1, 0), R(2, 0));
  down_ = f3(R(0, 1), R(1, 1), R(2, 1));
  forward_ = f3(R(0, 2), R(1, 2), R(2, 2));
  x_offset_px_ = static_cast<float>(x_offset_px);
  y_offset_px_ = static_cast<float>(y_offset_px);

  seen_.clear();
  for (const Shape& shape : shapes) {
    Seen seen;
    if (!project(shape, seen)) continue;
    const Mat3 M = transposed(shape.axes) * R;
    const Vec3 o = transposed(shape.axes) * (T_world_camera.t - shape.center);
    const double rz = shape.kind == ShapeKind::Capsule ? (shape.half.x + shape.half.y) / 2 : shape.half.z;
    const Vec3 s{1 / shape.half.x, 1 / shape.half.y, 1 / rz};
    seen.origin = f3(s.x * o.x, s.y * o.y, s.z * o.z);
    seen.dx = f3(s.x * M(0, 0), s.y * M(1, 0), s.z * M(2, 0));
    seen.dy = f3(s.x * M(0, 1), s.y * M(1, 1), s.z * M(2, 1));
    seen.dz = f3(s.x * M(0, 2), s.y * M(1, 2), s.z * M(2, 2));
    seen.kind = shape.kind;
    seen.straight = static_cast<float>(shape.half.z / rz);
    seen.shape = &shape;
    seen_.push_back(seen);
  }
  // Nearest first, in every tile: a ray may stop at a hit that is nearer than all that is left.
  std::sort(seen_.begin(), seen_.end(),
            [](const Seen& a, const Seen& b) { return a.nearest_m < b.nearest_m; });
  for (auto& tile : tiles_) tile.clear();
  for (std::size_t i = 0; i < seen_.size(); ++i) {
    for (int row = seen_[i].y0; row <= seen_[i].y1; ++row) {
      for (int column = seen_[i].x0; column <= seen_[i].x1; ++column) {
        tiles_[static_cast<std::size_t>(row * columns_ + column)].push_back(static_cast<std::uint16_t>(i));
      }
    }
  }
}

bool RayCaster::project(const Shape& shape, Seen& seen) const {
  const Mat3 R_camera_shape = transposed(T_world_camera_.R) * shape.axes;
  const Vec3 center = inverse(T_world_camera_) * shape.center;
  std::array<Vec3, 8> corners;
  for (std::size_t i = 0; i < 8; ++i) {
    const auto sign = [i](std::size_t bit) { return (i & bit) != 0 ? 1.0 : -1.0; };
    corners[i] = center + R_camera_shape * Vec3{sign(1) * shape.half.x, sign(2) * shape.half.y,
                                                sign(4) * half_length(shape)};
  }
  double x0 = 1e9, y0 = 1e9, x1 = -1e9, y1 = -1e9, nearest = 1e9;
  const auto include = [&](Vec3 p) {
    const double x = camera_.fx * p.x / p.z + camera_.cx, y = camera_.fy * p.y / p.z + camera_.cy;
    x0 = std::min(x0, x), y0 = std::min(y0, y), x1 = std::max(x1, x), y1 = std::max(y1, y);
    nearest = std::min(nearest, p.z);
  };
  for (std::size_t i = 0; i < 8; ++i) {
    const bool in_front = corners[i].z > kNearest_m;
    if (in_front) include(corners[i]);
    for (std::size_t bit : {1u, 2u, 4u}) {  // where an edge crosses the near plane
      const Vec3 a = corners[i], b = corners[i ^ bit];
      if (in_front && b.z <= kNearest_m) include(a + ((kNearest_m - a.z) / (b.z - a.z)) * (b - a));
    }
  }
  if (x1 < -1 || y1 < -1 || x0 > camera_.width || y0 > camera_.height) return false;
  const auto tile = [](double px, int count) {
    return std::clamp(static_cast<int>(std::floor(px / kTilePx)), 0, count - 1);
  };
  seen.x0 = tile(std::max(x0 - 1, -1e4), columns_), seen.x1 = tile(std::min(x1 + 1, 1e4), columns_);
  seen.y0 = tile(std::max(y0 - 1, -1e4), rows_), seen.y1 = tile(std::min(y1 + 1, 1e4), rows_);
  seen.nearest_m = static_cast<float>(nearest);
  return true;
}

float RayCaster::intersect(const Seen& s, F3 d) {
  const F3 o = s.origin;
  if (s.kind == ShapeKind::Box) {
    const F3 k{1 / d.x, 1 / d.y, 1 / d.z};
    const float ax = (-1 - o.x) * k.x, bx = (1 - o.x) * k.x, ay = (-1 - o.y) * k.y, by = (1 - o.y) * k.y;
    const float az = (-1 - o.z) * k.z, bz = (1 - o.z) * k.z;
    const float in = std::max(std::max(std::min(ax, bx), std::min(ay, by)), std::min(az, bz));
    const float out = std::min(std::min(std::max(ax, bx), std::max(ay, by)), std::max(az, bz));
    return in <= out && in > kNearest_m ? in : kNone;
  }
  const float a = d.x * d.x + d.y * d.y, b = o.x * d.x + o.y * d.y, c = o.x * o.x + o.y * o.y - 1;
  if (s.kind == ShapeKind::Ellipsoid) return first_root(a + d.z * d.z, b + o.z * d.z, c + o.z * o.z);

  const float side = first_root(a, b, c);
  if (std::abs(o.z + side * d.z) <= s.straight) return side;
  if (s.kind == ShapeKind::Cylinder) {
    const float t = (o.z > 0 ? 1 - o.z : -1 - o.z) / d.z;
    const float x = o.x + t * d.x, y = o.y + t * d.y;
    return t > kNearest_m && x * x + y * y <= 1 ? t : kNone;
  }
  float nearest = kNone;
  for (float end : {-s.straight, s.straight}) {
    const float oz = o.z - end;
    nearest = std::min(nearest, first_root(a + d.z * d.z, b + oz * d.z, c + oz * oz));
  }
  return nearest;
}

RayCaster::Hit RayCaster::trace(std::span<const std::uint16_t> candidates, float x, float y) const {
  Hit hit{kNone, nullptr};
  for (std::uint16_t i : candidates) {
    const Seen& seen = seen_[i];
    if (seen.nearest_m > hit.t) break;
    const float t = intersect(seen, direction(seen, x, y));
    if (t < hit.t) hit = {t, &seen};
  }
  if (hit.seen != nullptr) return hit;
  const F3 d{x * right_.x + y * down_.x + forward_.x, x * right_.y + y * down_.y + forward_.y,
             x * right_.z + y * down_.z + forward_.z};
  const auto half_x = static_cast<float>(room_.half_x), half_y = static_cast<float>(room_.half_y);
  // By the sign, which a zero has, too: along a plane the way to it is +infinity.
  hit.t = std::min(std::min(((std::signbit(d.x) ? -half_x : half_x) - position_.x) / d.x,
                            ((std::signbit(d.y) ? -half_y : half_y) - position_.y) / d.y),
                   ((std::signbit(d.z) ? 0.0f : static_cast<float>(room_.height)) - position_.z) / d.z);
  return hit;
}

}  // namespace stillmap::synthetic
