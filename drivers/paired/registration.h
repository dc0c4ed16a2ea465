// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "core/camera.h"
#include "core/geometry.h"
#include "core/image.h"

namespace stillmap {

/// Moves a depth picture into the view of the colour camera beside it: each reading is lifted by the depth
/// camera's lens, moved by the extrinsics, and shown by the colour camera's lens. Where several fall on one
/// pixel, the nearest stays, so what the colour camera cannot see is hidden. A reading covers as many pixels
/// as its own pixel is large there.
///
/// All memory is taken at construction: 12 bytes a depth pixel. One thread.
class DepthRegistration {
 public:
  /// `depth` says the depth camera's size and lens; its depth units are `colour`'s.
  DepthRegistration(const CameraModel& colour, const CameraModel& depth, const Pose& T_colour_depth);

  /// `from` has the depth camera's size, `into` the colour camera's; 0 = no reading in both.
  void apply(ImageView<const std::uint16_t> from, ImageView<std::uint16_t> into);

  int width() const { return width_; }
  int height() const { return height_; }

 private:
  void project_row(const std::uint16_t* from, int y);

  CameraModel colour_;
  int width_, height_;
  float tx_, ty_, tz_;       // of T_colour_depth, in depth units
  float half_u_, half_v_;    // of a reading's footprint in the colour picture, px, at equal distance
  float max_radius2_;        // of the undistorted image plane, beyond which the lens model says nothing
  std::vector<float> rays_;  // the depth camera's in the colour camera's axes; a row of x, one of y, one of z
  /// Where a row's readings fall: pixels from left to before right, and from top to before bottom; and what
  /// they read from there. Empty where they fall nowhere.
  std::vector<int> left_, right_, top_, bottom_, reading_;
};

}  // namespace stillmap
