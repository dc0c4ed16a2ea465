// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/feature.h"

namespace stillmap {

/// Finds the features of a frame near a place on the undistorted picture. Places are in ideal pixels:
/// fx * ray_x + cx, fy * ray_y + cy, so that no search pays for the lens.
class FeatureGrid {
 public:
  FeatureGrid(Arena& arena, std::size_t feature_capacity, const CameraModel& camera)
      : camera_(camera), items_(arena.take<Item>("feature_grid", feature_capacity)) {}

  /// Indexes `features` by where they are now.
  void build(std::span<const Feature> features) {
    starts_.fill(0);
    for (const Feature& f : features) ++starts_[cell_of(f) + 1];
    for (std::size_t i = 1; i < starts_.size(); ++i)
      starts_[i] = static_cast<std::uint16_t>(starts_[i] + starts_[i - 1]);
    auto next = starts_;
    for (std::size_t i = 0; i < features.size(); ++i) {
      const Feature& f = features[i];
      items_[next[cell_of(f)]++] = {static_cast<float>(u_of(f)), static_cast<float>(v_of(f)),
                                    static_cast<std::uint32_t>(i)};
    }
  }

  double u_of(const Feature& f) const { return camera_.fx * f.ray_x + camera_.cx; }
  double v_of(const Feature& f) const { return camera_.fy * f.ray_y + camera_.cy; }

  /// Calls `visit(index)` for every feature within `radius_px` of (u, v), cell by cell in a fixed order.
  template <class Visit>
  void for_each_near(double u, double v, double radius_px, Visit&& visit) const {
    const int c0 = column_of(u - radius_px), c1 = column_of(u + radius_px);
    const int r0 = row_of(v - radius_px), r1 = row_of(v + radius_px);
    for (int row = r0; row <= r1; ++row) {
      for (int column = c0; column <= c1; ++column) {
        const auto cell = static_cast<std::size_t>(row * kColumns + column);
        for (std::size_t i = starts_[cell]; i < starts_[cell + 1]; ++i) {
          const Item& item = items_[i];
          const double du = item.u - u, dv = item.v - v;
          if (du * du + dv * dv <= radius_px * radius_px) visit(static_cast<std::size_t>(item.feature));
        }
      }
    }
  }

 private:
  static constexpr int kColumns = 40, kRows = 30;
  // Undistorting may move a corner of the picture outside of it; the outermost cells take what lies beyond.
  int column_of(double u) const {
    return static_cast<int>(std::clamp(u * kColumns / camera_.width, 0.0, kColumns - 1.0));
  }
  int row_of(double v) const {
    return static_cast<int>(std::clamp(v * kRows / camera_.height, 0.0, kRows - 1.0));
  }
  std::size_t cell_of(const Feature& f) const {
    return static_cast<std::size_t>(row_of(v_of(f)) * kColumns + column_of(u_of(f)));
  }

  struct Item {
    float u, v;
    std::uint32_t feature;
  };
  CameraModel camera_;
  std::span<Item> items_;  // cell by cell
  std::array<std::uint16_t, kColumns * kRows + 1> starts_{};
};

}  // namespace stillmap
