// SPDX-License-Identifier: Apache-2.0
#include "track/pyramid.h"

#include <algorithm>
#include <cmath>

namespace stillmap {

namespace {

/// Where a target pixel centre falls in the source: index of the left neighbour and the weight of the right one
/// in 1/128.
std::uint32_t source_of(int target, double ratio, int source_size) {
  const double position = std::clamp((target + 0.5) * ratio - 0.5, 0.0, source_size - 1.001);
  const auto left = static_cast<std::uint32_t>(position);
  return left << 8 | static_cast<std::uint32_t>(std::lround((position - left) * 128));
}

/// Bilinear. Rows first, which the compiler turns into vector code, then the gather along the row.
void resample(ImageView<const std::uint8_t> from, ImageView<std::uint8_t> to, std::span<std::uint16_t> row,
              std::span<std::uint32_t> columns) {
  const double ratio_x = static_cast<double>(from.width) / to.width;
  const double ratio_y = static_cast<double>(from.height) / to.height;
  for (int x = 0; x < to.width; ++x) columns[static_cast<std::size_t>(x)] = source_of(x, ratio_x, from.width);
  for (int y = 0; y < to.height; ++y) {
    const std::uint32_t source = source_of(y, ratio_y, from.height);
    const std::uint32_t below = source & 255, above = 128 - below;
    const std::uint8_t* a = from.row(static_cast<int>(source >> 8));
    const std::uint8_t* b = from.row(static_cast<int>(source >> 8) + 1);
    std::uint16_t* mixed = row.data();
    for (int x = 0; x < from.width; ++x) mixed[x] = static_cast<std::uint16_t>(a[x] * above + b[x] * below);
    std::uint8_t* out = to.row(y);
    for (int x = 0; x < to.width; ++x) {
      const std::uint32_t column = columns[static_cast<std::size_t>(x)], right = column & 255;
      const std::uint16_t* m = mixed + (column >> 8);
      out[x] = static_cast<std::uint8_t>((m[0] * (128 - right) + m[1] * right + (1U << 13)) >> 14);
    }
  }
}

/// Gaussian taps for sigma 2 in 1/256, centre first.
constexpr std::array<unsigned, 4> kTaps{54, 47, 33, 21};
static_assert(kTaps[0] + 2 * (kTaps[1] + kTaps[2] + kTaps[3]) == 256);

void smooth_level(ImageView<const std::uint8_t> from, ImageView<std::uint8_t> to, std::span<std::uint16_t> row) {
  std::uint16_t* column_sum = row.data();
  for (int y = 3; y < from.height - 3; ++y) {
    const std::uint8_t* r[7];
    for (int k = 0; k < 7; ++k) r[k] = from.row(y + k - 3);
    for (int x = 0; x < from.width; ++x) {
      column_sum[x] = static_cast<std::uint16_t>((r[3][x] * kTaps[0] + (r[2][x] + r[4][x]) * kTaps[1] +
                                                  (r[1][x] + r[5][x]) * kTaps[2] + (r[0][x] + r[6][x]) * kTaps[3]) >> 1);
    }
    std::uint8_t* out = to.row(y);
    for (int x = 3; x < from.width - 3; ++x) {
      const std::uint16_t* c = column_sum + x;
      const unsigned sum = c[0] * kTaps[0] + static_cast<unsigned>(c[-1] + c[1]) * kTaps[1] +
                           static_cast<unsigned>(c[-2] + c[2]) * kTaps[2] + static_cast<unsigned>(c[-3] + c[3]) * kTaps[3];
      out[x] = static_cast<std::uint8_t>((sum + (1U << 14)) >> 15);
    }
  }
}

}  // namespace

Pyramid::Pyramid(Arena& arena, int width, int height, int levels, double scale_factor) : levels_(levels) {
  double scale = 1;
  for (int level = 0; level < levels; ++level, scale *= scale_factor) {
    const auto l = static_cast<std::size_t>(level);
    scales_[l] = scale;
    const int w = static_cast<int>(std::lround(width / scale)), h = static_cast<int>(std::lround(height / scale));
    const auto pixels = static_cast<std::size_t>(w) * static_cast<std::size_t>(h);
    if (level > 0) resampled_[l] = {arena.take<std::uint8_t>("pyramid.level", pixels).data(), w, h, w};
    smooth_[l] = {arena.take<std::uint8_t>("pyramid.smooth", pixels).data(), w, h, w};
  }
  row_ = arena.take<std::uint16_t>("pyramid.row", static_cast<std::size_t>(width));
  columns_ = arena.take<std::uint32_t>("pyramid.columns", static_cast<std::size_t>(width));
}

void Pyramid::build(ImageView<const std::uint8_t> grey) {
  images_[0] = grey;
  for (std::size_t l = 0; l < static_cast<std::size_t>(levels_); ++l) {
    if (l > 0) {
      resample(images_[l - 1], resampled_[l], row_, columns_);
      images_[l] = resampled_[l];
    }
    smooth_level(images_[l], smooth_[l], row_);
  }
}

}  // namespace stillmap
