// SPDX-License-Identifier: Apache-2.0
#include "track/pyramid.h"

#include <algorithm>
#include <cmath>

#include "core/vector_clones.h"

namespace stillmap {

namespace {

/// Where a target pixel centre falls in the source: index of the left neighbour and the weight of the right
/// one in 1/128.
std::uint32_t source_of(int target, double ratio, int source_size) {
  const double position = std::clamp((target + 0.5) * ratio - 0.5, 0.0, source_size - 1.001);
  const auto left = static_cast<std::uint32_t>(position);
  return left << 8 | static_cast<std::uint32_t>(std::lround((position - left) * 128));
}

/// Bilinear. Rows first, which the compiler turns into vector code, then the gather along the row.
STILLMAP_VECTOR_CLONES void resample(ImageView<const std::uint8_t> from, ImageView<std::uint8_t> to,
                                     std::span<std::uint16_t> row, std::span<std::uint32_t> columns) {
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
      const std::uint32_t column = columns[static_cast<std::size_t>(x)];
      const std::uint16_t* m = mixed + (column >> 8);
      const int right = static_cast<int>(column & 255);
      out[x] = static_cast<std::uint8_t>((m[0] * 128 + (m[1] - m[0]) * right + (1 << 13)) >> 14);
    }
  }
}

/// Gaussian taps for sigma 2 in 1/256, centre first.
constexpr std::array<unsigned, 4> kTaps{54, 49, 34, 18};  // as exp(-x^2 / 8), rounded so that the sum is 256
static_assert(kTaps[0] + 2 * (kTaps[1] + kTaps[2] + kTaps[3]) == 256);

/// One pass of the filter; every sum fits 16 bits, which is what makes it quick in vector units.
[[gnu::always_inline]] inline std::uint8_t weighted(unsigned m3, unsigned m2, unsigned m1, unsigned c,
                                                    unsigned p1, unsigned p2, unsigned p3) {
  const auto sum = static_cast<std::uint16_t>(c * kTaps[0] + (m1 + p1) * kTaps[1] + (m2 + p2) * kTaps[2] +
                                              (m3 + p3) * kTaps[3] + 128);
  return static_cast<std::uint8_t>(sum >> 8);
}

STILLMAP_VECTOR_CLONES void smooth_level(ImageView<const std::uint8_t> from, ImageView<std::uint8_t> to,
                                         std::span<std::uint8_t> row) {
  std::uint8_t* column = row.data();
  for (int y = 3; y < from.height - 3; ++y) {
    const std::uint8_t *a = from.row(y - 3), *b = from.row(y - 2), *c = from.row(y - 1), *d = from.row(y),
                       *e = from.row(y + 1), *f = from.row(y + 2), *g = from.row(y + 3);
    for (int x = 0; x < from.width; ++x) column[x] = weighted(a[x], b[x], c[x], d[x], e[x], f[x], g[x]);
    std::uint8_t* out = to.row(y);
    for (int x = 3; x < from.width - 3; ++x) {
      out[x] = weighted(column[x - 3], column[x - 2], column[x - 1], column[x], column[x + 1], column[x + 2],
                        column[x + 3]);
    }
  }
}

}  // namespace

Pyramid::Pyramid(Arena& arena, int width, int height, int levels, double scale_factor) : levels_(levels) {
  double next_scale = 1;
  for (double& s : scales_) {
    s = next_scale;  // of all: the keyframes of a resumed map may know more levels than this run
    next_scale *= scale_factor;
  }
  for (int level = 0; level < levels; ++level) {
    const auto l = static_cast<std::size_t>(level);
    const int w = static_cast<int>(std::lround(width / scales_[l])),
              h = static_cast<int>(std::lround(height / scales_[l]));
    const auto pixels = static_cast<std::size_t>(w) * static_cast<std::size_t>(h);
    if (level > 0) resampled_[l] = {arena.take<std::uint8_t>("pyramid.level", pixels).data(), w, h, w};
    smooth_[l] = {arena.take<std::uint8_t>("pyramid.smooth", pixels).data(), w, h, w};
  }
  smooth_row_ = arena.take<std::uint8_t>("pyramid.smooth_row", static_cast<std::size_t>(width));
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
    smooth_level(images_[l], smooth_[l], smooth_row_);
  }
}

}  // namespace stillmap
