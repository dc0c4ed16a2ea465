// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "core/arena.h"
#include "core/image.h"

namespace stillmap {

/// A grey picture at falling resolutions, each level also smoothed for descriptors. Memory from the arena;
/// `build` takes nothing from the heap.
class Pyramid {
 public:
  static constexpr int kMaxLevels = 8;

  Pyramid(Arena& arena, int width, int height, int levels, double scale_factor);
  /// Level 0 is a view of `grey`, which must outlive the use of this pyramid; the others are resampled from
  /// it.
  void build(ImageView<const std::uint8_t> grey);

  int levels() const { return levels_; }
  /// Pixels of level 0 per pixel of this level.
  double scale(int level) const { return scales_[static_cast<std::size_t>(level)]; }
  ImageView<const std::uint8_t> image(int level) const { return images_[static_cast<std::size_t>(level)]; }
  /// Gaussian, sigma 2 px, 7 taps. The outermost three rows and columns are undefined.
  ImageView<const std::uint8_t> smooth(int level) const { return smooth_[static_cast<std::size_t>(level)]; }

 private:
  int levels_;
  std::array<double, kMaxLevels> scales_{};
  std::array<ImageView<const std::uint8_t>, kMaxLevels> images_{};
  std::array<ImageView<std::uint8_t>, kMaxLevels> resampled_{}, smooth_{};
  std::span<std::uint8_t> row_;         // one row between the two passes of resampling
  std::span<std::uint8_t> smooth_row_;  // and of smoothing
};

}  // namespace stillmap
