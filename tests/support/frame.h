// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "core/frame_pool.h"

namespace stillmap::test {

/// A frame with pixels of its own, black and without depth.
struct Frame : FrameSlot {
  Frame(int width, int height)
      : colour_pixels(static_cast<std::size_t>(width * height)), depth_pixels(colour_pixels.size()) {
    colour = {colour_pixels.data(), width, height, width};
    depth = {depth_pixels.data(), width, height, width};
  }
  std::vector<Bgr> colour_pixels;
  std::vector<std::uint16_t> depth_pixels;
};

}  // namespace stillmap::test
