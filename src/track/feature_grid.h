// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "track/feature_extractor.h"

namespace stillmap {

/// Pyramid levels, both included.
struct Octaves {
  int first = 0, last = Pyramid::kMaxLevels - 1;
};
/// Those at which a corner seen at `octave` may be found again.
inline Octaves beside(int octave) {
  return {std::max(0, octave - 1), std::min(octave + 1, Pyramid::kMaxLevels - 1)};
}

/// Finds the features of a frame near a place on the undistorted picture. Places are in ideal pixels:
/// fx * ray_x + cx, fy * ray_y + cy, so that no search pays for the lens. Octave by octave and in each cell
/// by cell, with what a search asks of them beside one another, so that a wide one goes through memory in
/// order.
class FeatureGrid {
 public:
  struct Item {
    float u, v;     ///< ideal pixels
    float depth_m;  ///< 0 = no reading
    std::uint16_t feature;
    std::uint8_t octave;
    Descriptor descriptor;
  };

  FeatureGrid(Arena& arena, std::size_t feature_capacity, const CameraModel& camera)
      : camera_(camera), items_(arena.take<Item>("feature_grid", feature_capacity)) {}

  /// Indexes the features of `frame` by where they are now.
  void build(const FrameFeatures& frame) {
    starts_.fill(0);
    for (const Feature& f : frame.features) ++starts_[cell_of(f) + 1];
    for (std::size_t i = 1; i < starts_.size(); ++i)
      starts_[i] = static_cast<std::uint16_t>(starts_[i] + starts_[i - 1]);
    auto next = starts_;
    for (std::size_t i = 0; i < frame.features.size(); ++i) {
      const Feature& f = frame.features[i];
      items_[next[cell_of(f)]++] = {static_cast<float>(u_of(f)),
                                    static_cast<float>(v_of(f)),
                                    f.depth_m,
                                    static_cast<std::uint16_t>(i),
                                    f.octave,
                                    frame.descriptors[i]};
    }
  }

  double u_of(const Feature& f) const { return camera_.fx * f.ray_x + camera_.cx; }
  double v_of(const Feature& f) const { return camera_.fy * f.ray_y + camera_.cy; }

  /// Calls `visit(item)` for every feature of these octaves within `radius_px` of (u, v), in a fixed order.
  template <class Visit>
  void for_each_near(Octaves octaves, double u, double v, double radius_px, Visit&& visit) const {
    const int c0 = column_of(u - radius_px), c1 = column_of(u + radius_px);
    const int r0 = row_of(v - radius_px), r1 = row_of(v + radius_px);
    const auto at_u = static_cast<float>(u), at_v = static_cast<float>(v);
    const auto within = static_cast<float>(radius_px * radius_px);
    for (int octave = octaves.first; octave <= octaves.last; ++octave) {
      for (int row = r0; row <= r1; ++row) {
        const std::size_t end = starts_[cell(octave, row, c1) + 1];
        for (std::size_t i = starts_[cell(octave, row, c0)]; i < end; ++i) {
          const float du = items_[i].u - at_u, dv = items_[i].v - at_v;
          if (du * du + dv * dv <= within) visit(items_[i]);
        }
      }
    }
  }

 private:
  static constexpr int kColumns = 20, kRows = 15;
  // Undistorting may move a corner of the picture outside of it; the outermost cells take what lies beyond.
  int column_of(double u) const {
    return static_cast<int>(std::clamp(u * kColumns / camera_.width, 0.0, kColumns - 1.0));
  }
  int row_of(double v) const {
    return static_cast<int>(std::clamp(v * kRows / camera_.height, 0.0, kRows - 1.0));
  }
  static std::size_t cell(int octave, int row, int column) {
    return static_cast<std::size_t>((octave * kRows + row) * kColumns + column);
  }
  std::size_t cell_of(const Feature& f) const { return cell(f.octave, row_of(v_of(f)), column_of(u_of(f))); }

  CameraModel camera_;
  std::span<Item> items_;
  std::array<std::uint16_t, std::size_t{Pyramid::kMaxLevels} * kRows * kColumns + 1> starts_{};
};

}  // namespace stillmap
