// SPDX-License-Identifier: Apache-2.0
#include "track/pyramid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "core/check.h"
#include "core/vector_clones.h"

namespace stillmap {

namespace {

using U8x8 = std::uint8_t __attribute__((vector_size(8)));
using U8x16 = std::uint8_t __attribute__((vector_size(16)));
using U16x8 = std::uint16_t __attribute__((vector_size(16)));

/// Byte which[i] of `from` for every i: one instruction of SSSE3 or NEON.
[[gnu::always_inline]] inline U8x16 pick(U8x16 from, U8x16 which) {
#if defined(__clang__)
  U8x16 out{};
  for (int i = 0; i < 16; ++i) out[i] = from[which[i]];
  return out;
#else
  return __builtin_shuffle(from, which);
#endif
}

/// Where a target pixel centre falls in the source.
struct Source {
  int left;      // neighbour
  int weight_r;  // of the right one, in 1/128
};
Source source_of(int target, double ratio, int source_size) {
  const double position = std::clamp((target + 0.5) * ratio - 0.5, 0.0, source_size - 1.001);
  const int left = static_cast<int>(position);
  return {left, static_cast<int>(std::lround((position - left) * 128))};
}

constexpr int kWidest = 1280;  // picture

/// Eight neighbours of a target row, and where they come from: all within sixteen source columns, since
/// levels differ by less than a factor of two.
struct Eight {
  int first;       // source column that `pick` counts from
  U8x16 picked;    // left and right neighbour of each in turn
  U16x8 weight_r;  // in 1/128
};
Eight eight_at(int target, double ratio, int source_size) {
  Eight eight{.first = source_of(target, ratio, source_size).left, .picked = {}, .weight_r = {}};
  for (int i = 0; i < 8; ++i) {
    const Source source = source_of(target + i, ratio, source_size);
    const auto left = static_cast<std::uint8_t>(source.left - eight.first);
    eight.picked[2 * i] = left;
    eight.picked[2 * i + 1] = static_cast<std::uint8_t>(left + 1);
    eight.weight_r[i] = static_cast<std::uint16_t>(source.weight_r);
  }
  return eight;
}

/// Eight target pixels from the source row mixed so far.
[[gnu::always_inline]] inline U8x8 resample_eight(const std::uint8_t* mixed, const Eight& eight) {
  U8x16 around;
  std::memcpy(&around, mixed + eight.first, sizeof around);
  const auto neighbours = reinterpret_cast<U16x8>(pick(around, eight.picked));
  const U16x8 left = neighbours & 255, right = neighbours >> 8;
  return __builtin_convertvector((left * (128 - eight.weight_r) + right * eight.weight_r + 64) >> 7, U8x8);
}

/// Bilinear: down the columns into one row, then along it, rounded each time.
STILLMAP_VECTOR_CLONES void resample(ImageView<const std::uint8_t> from, ImageView<std::uint8_t> to,
                                     std::span<std::uint8_t> row) {
  const double ratio_x = static_cast<double>(from.width) / to.width;
  const double ratio_y = static_cast<double>(from.height) / to.height;
  std::array<Eight, kWidest / 8> eights;
  STILLMAP_CHECK(to.width <= kWidest);
  for (int x = 0; x < to.width; x += 8)
    eights[static_cast<std::size_t>(x / 8)] = eight_at(x, ratio_x, from.width);
  for (int y = 0; y < to.height; ++y) {
    const Source source = source_of(y, ratio_y, from.height);
    const auto below = static_cast<unsigned>(source.weight_r), above = 128 - below;
    const std::uint8_t *a = from.row(source.left), *b = from.row(source.left + 1);
    std::uint8_t* mixed = row.data();
    for (int x = 0; x < from.width; ++x) {
      const auto sum = static_cast<std::uint16_t>(a[x] * above + b[x] * below + 64);
      mixed[x] = static_cast<std::uint8_t>(sum >> 7);
    }
    std::uint8_t* out = to.row(y);
    for (int x = 0; x < to.width; x += 8) {
      const U8x8 pixels = resample_eight(mixed, eights[static_cast<std::size_t>(x / 8)]);
      if (to.width - x >= 8) {
        std::memcpy(out + x, &pixels, sizeof pixels);  // of a size that compilers need no call for
      } else {
        std::memcpy(out + x, &pixels, static_cast<std::size_t>(to.width - x));
      }
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
  row_ = arena.take<std::uint8_t>("pyramid.row", static_cast<std::size_t>(width) + sizeof(U8x16));
}

void Pyramid::build(ImageView<const std::uint8_t> grey) {
  images_[0] = grey;
  for (std::size_t l = 0; l < static_cast<std::size_t>(levels_); ++l) {
    if (l > 0) {
      resample(images_[l - 1], resampled_[l], row_);
      images_[l] = resampled_[l];
    }
    smooth_level(images_[l], smooth_[l], smooth_row_);
  }
}

}  // namespace stillmap
