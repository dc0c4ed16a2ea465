// SPDX-License-Identifier: Apache-2.0
#include "drivers/paired/registration.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"

namespace stillmap {

namespace {

/// The farthest corner of the picture, squared, on the undistorted image plane, and a tenth beyond.
float usable_radius2(const CameraModel& c) {
  double worst = 0;
  for (const double x : {0.0, c.width - 1.0}) {
    for (const double y : {0.0, c.height - 1.0}) {
      const Vec2 ray = c.undistort({x, y});
      worst = std::max(worst, ray.x * ray.x + ray.y * ray.y);
    }
  }
  return static_cast<float>(worst * 1.21);
}

/// The next whole number from `v` on, kept from 0 to `last`; without a call, so that four are done at once.
int first_from(float v, int last) {
  constexpr float kOffset = 4096;  // pictures are smaller
  const float kept = std::min(std::max(v, -1.f), kOffset - 1);
  return std::min(std::max(4096 - static_cast<int>(kOffset - kept), 0), last);
}

}  // namespace

DepthRegistration::DepthRegistration(const CameraModel& colour, const CameraModel& depth,
                                     const Pose& T_colour_depth)
    : colour_(colour),
      width_(depth.width),
      height_(depth.height),
      tx_(static_cast<float>(T_colour_depth.t.x * colour.depth_units_per_m)),
      ty_(static_cast<float>(T_colour_depth.t.y * colour.depth_units_per_m)),
      tz_(static_cast<float>(T_colour_depth.t.z * colour.depth_units_per_m)),
      half_u_(static_cast<float>(0.5 * colour.fx / depth.fx)),
      half_v_(static_cast<float>(0.5 * colour.fy / depth.fy)),
      max_radius2_(usable_radius2(colour)),
      rays_(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_) * 3),
      left_(static_cast<std::size_t>(width_)),
      right_(left_.size()),
      top_(left_.size()),
      bottom_(left_.size()),
      reading_(left_.size()) {
  float* row = rays_.data();
  for (int y = 0; y < height_; ++y, row += 3 * width_) {
    for (int x = 0; x < width_; ++x) {
      const Vec2 plane = depth.undistort({static_cast<double>(x), static_cast<double>(y)});
      const Vec3 ray = T_colour_depth.R * Vec3{plane.x, plane.y, 1};
      row[x] = static_cast<float>(ray.x);
      row[x + width_] = static_cast<float>(ray.y);
      row[x + 2 * width_] = static_cast<float>(ray.z);
    }
  }
}

void DepthRegistration::project_row(const std::uint16_t* from, int y) {
  const float* rx = rays_.data() + static_cast<std::ptrdiff_t>(y) * 3 * width_;
  const float* ry = rx + width_;
  const float* rz = ry + width_;
  const auto k1 = static_cast<float>(colour_.k1), k2 = static_cast<float>(colour_.k2),
             k3 = static_cast<float>(colour_.k3), p1 = static_cast<float>(colour_.p1),
             p2 = static_cast<float>(colour_.p2);
  const auto fx = static_cast<float>(colour_.fx), fy = static_cast<float>(colour_.fy),
             cx = static_cast<float>(colour_.cx), cy = static_cast<float>(colour_.cy);
  const int count = width_, width = colour_.width, height = colour_.height;
  int *left = left_.data(), *right = right_.data(), *top = top_.data(), *bottom = bottom_.data(),
      *reading = reading_.data();
  // Without branches and with its own count, so that the compiler takes several readings at once.
  for (int i = 0; i < count; ++i) {
    const auto d = static_cast<float>(from[i]);
    const float z = d * rz[i] + tz_;
    const float inverse_z = 1.f / std::max(z, 1e-3f);
    const float a = (d * rx[i] + tx_) * inverse_z, b = (d * ry[i] + ty_) * inverse_z;
    const float r2 = a * a + b * b;
    const float radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
    const float u = fx * (a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a)) + cx;
    const float v = fy * (b * radial + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b) + cy;
    const bool seen = (d > 0) & (z >= 0.5f) & (z < 65535.f) & (r2 <= max_radius2_);
    left[i] = first_from(u - half_u_, width);
    right[i] = seen ? first_from(u + half_u_, width) : 0;
    top[i] = first_from(v - half_v_, height);
    bottom[i] = first_from(v + half_v_, height);
    // Never negative, and lround would not go into vector units.
    // NOLINTNEXTLINE(bugprone-incorrect-roundings)
    reading[i] = static_cast<int>(z + 0.5f);
  }
}

void DepthRegistration::apply(ImageView<const std::uint16_t> from, ImageView<std::uint16_t> into) {
  STILLMAP_CHECK(from.width == width_ && from.height == height_);
  STILLMAP_CHECK(into.width == colour_.width && into.height == colour_.height);
  for (int y = 0; y < into.height; ++y) std::fill_n(into.row(y), into.width, std::uint16_t{0});
  for (int y = 0; y < height_; ++y) {
    project_row(from.row(y), y);
    for (std::size_t i = 0; i < left_.size(); ++i) {
      const auto reading = static_cast<std::uint16_t>(reading_[i]);
      for (int row = top_[i]; row < bottom_[i]; ++row) {
        std::uint16_t* to = into.row(row);
        for (int column = left_[i]; column < right_[i]; ++column) {
          // No reading counts as farthest: 0 - 1 wraps around to the largest.
          if (static_cast<std::uint16_t>(reading - 1) < static_cast<std::uint16_t>(to[column] - 1))
            to[column] = reading;
        }
      }
    }
  }
}

}  // namespace stillmap
