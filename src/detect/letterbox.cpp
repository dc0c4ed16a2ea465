// SPDX-License-Identifier: Apache-2.0
#include "detect/letterbox.h"

#include <algorithm>
#include <cmath>

namespace stillmap {

Letterbox::Letterbox(int picture_width_px, int picture_height_px, int input_width_px, int input_height_px)
    : input_width(input_width_px),
      input_height(input_height_px),
      picture_width(picture_width_px),
      picture_height(picture_height_px),
      scale(std::min(static_cast<double>(input_width_px) / picture_width_px,
                     static_cast<double>(input_height_px) / picture_height_px)) {
  width = std::max(1, static_cast<int>(std::lround(picture_width * scale)));
  height = std::max(1, static_cast<int>(std::lround(picture_height * scale)));
  x0 = (input_width_px - width) / 2;
  y0 = (input_height_px - height) / 2;
}

Box Letterbox::to_picture(const Box& in_input) const {
  const auto undo = [this](float at, int offset, int size) {
    return static_cast<float>(
        std::clamp((static_cast<double>(at) - offset) / scale, 0.0, static_cast<double>(size)));
  };
  return {undo(in_input.x0, x0, picture_width), undo(in_input.y0, y0, picture_height),
          undo(in_input.x1, x0, picture_width), undo(in_input.y1, y0, picture_height)};
}

}  // namespace stillmap
