// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/detection.h"

namespace stillmap {

/// A picture shrunk or grown without distortion into the middle of a network's input.
struct Letterbox {
  int input_width = 0, input_height = 0;      ///< px of the network's input
  int picture_width = 0, picture_height = 0;  ///< px of the camera's picture
  int x0 = 0, y0 = 0, width = 0, height = 0;  ///< where the picture lies in the input, px of the input
  double scale = 1;                           ///< input px per picture px

  Letterbox(int picture_width_px, int picture_height_px, int input_width_px, int input_height_px);

  /// From the input to the picture, clipped to it.
  Box to_picture(const Box& in_input) const;
};

}  // namespace stillmap
