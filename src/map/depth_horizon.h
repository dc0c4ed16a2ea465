// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/arena.h"
#include "core/camera.h"

namespace stillmap {

/// How far a depth picture sees, square by square: what lies behind all of it, it says nothing of. One
/// thread.
class DepthHorizon {
 public:
  /// Squares are so wide, px.
  static constexpr int kSquare_px = 16;

  /// `rays` must be of this camera.
  DepthHorizon(Arena& arena, const CameraModel& camera, const RayTable& rays);

  /// `z_m` as MeasuredDepth has it.
  void take(std::span<const float> z_m);
  /// The farthest depth in all squares that a ball of the camera frame (m) may be seen in; 0 where nothing
  /// was measured there, infinity around the camera itself.
  float farthest_m(float x, float y, float z, float radius) const;

 private:
  /// What the rays through one row or column of squares lie between, as x / z or y / z.
  struct Slopes {
    float least = 0, most = 0;
  };

  int width_, height_;
  std::span<Slopes> columns_, rows_;
  std::span<float> farthest_m_;  // of each square, row-major
  std::span<float> strip_m_;     // of each column of pixels in one row of squares
};

}  // namespace stillmap
