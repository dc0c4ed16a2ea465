// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/dynamic_mask.h"
#include "core/image.h"

namespace stillmap {

/// What one depth picture says along the ray of each pixel, boiled down to a number z in m:
///   z > 0  something still stands at depth z;
///   z < 0  the ray is free up to |z|, and what stands there is not mapped: a mover; beyond the map's range;
///   or a depth
///          silhouette, where a reading mixes the near and the far surface and belongs to neither (|z| is the
///          near one);
///   z = 0  nothing: no reading, or one out of the trusted range.
/// One thread.
class MeasuredDepth {
 public:
  MeasuredDepth(Arena& arena, const CameraModel& camera, double max_range_m);

  /// `depth` is of the camera's size and in its depth units; `mask` belongs to the same frame. What it calls
  /// Dynamic is not mapped; under the paper's rule all of a dynamic box, as the paper removes it from colour
  /// and depth of a keyframe.
  void prepare(ImageView<const std::uint16_t> depth, const DynamicMask& mask);
  /// Row-major, camera.width * camera.height numbers as above.
  std::span<const float> z_m() const { return z_m_; }

 private:
  void prepare_row(ImageView<const std::uint16_t> depth, int y);
  /// Depth readings as they are in the picture, inclusive.
  struct Readings {
    int first = 0, last = std::numeric_limits<std::uint16_t>::max();
  };
  /// What of them lies in the cell's interval, as `label_at` has it.
  Readings readings_of(const DynamicMask::Cell& cell) const;
  void leave_out(ImageView<const std::uint16_t> depth, const DynamicMask& mask);
  void leave_out_in(const Box& region, Readings readings, ImageView<const std::uint16_t> depth);

  CameraModel camera_;
  float max_range_m_;
  std::span<float> z_m_;
};

}  // namespace stillmap
