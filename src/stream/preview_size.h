// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/camera.h"

namespace stillmap::stream {

/// The preview's size: the camera's picture with `step` x `step` pixels averaged into one, so that it is at
/// most 400 wide. Picture, annotations and calibration are all of this size.
struct PreviewSize {
  explicit PreviewSize(const CameraModel& camera)
      : step((camera.width + 399) / 400), width(camera.width / step), height(camera.height / step) {}
  /// A coordinate of the full picture; pixel centres are at whole numbers in both.
  double scaled(double pixel) const { return (pixel + 0.5) / step - 0.5; }

  int step, width, height;
};

}  // namespace stillmap::stream
