// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/image.h"

namespace stillmap {

/// Scales pictures of one size to another, row by row. Growing and shrinking by less than half interpolates
/// between pixels; shrinking further takes the mean of what a pixel covers, so that nothing slips between.
/// Equals OpenCV's INTER_LINEAR and INTER_AREA byte for byte, but a mean over parts of pixels, which may be a
/// level beside. No heap after construction.
class PictureScaler {
 public:
  /// Sizes in px, at least 1.
  PictureScaler(int from_width, int from_height, int to_width, int to_height);

  /// Row `y` of the scaled picture, to_width pixels. `from` is of the size promised.
  void row(ImageView<const Bgr> from, int y, std::span<Bgr> out);

 private:
  /// What one pixel of the result sees along one axis: interpolation's two neighbours, or a mean's first
  /// pixel, count, and the shares of the first and the last.
  struct Tap {
    int first = 0, second = 0;
    int weight = 0;  // of the second, in 1/2048
    float first_share = 1, last_share = 1;
  };
  static std::vector<Tap> interpolating(int from, int to);
  static std::vector<Tap> averaging(int from, int to);
  void interpolate(ImageView<const Bgr> from, const Tap& tap, std::span<Bgr> out) const;
  void average(ImageView<const Bgr> from, const Tap& tap, std::span<Bgr> out);
  void average_whole(ImageView<const Bgr> from, int y, std::span<Bgr> out) const;

  bool averages_;
  int whole_x_ = 0, whole_y_ = 0;  // averaging so many whole pixels
  std::vector<Tap> columns_, rows_;
  std::vector<float> sums_;  // of the rows that a pixel covers, 3 a column of the picture
};

}  // namespace stillmap
