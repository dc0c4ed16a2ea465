// SPDX-License-Identifier: Apache-2.0
#include "track/fast_corners.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "core/vector_clones.h"

namespace stillmap {

namespace {

/// The Bresenham circle of radius 3, clockwise from the top.
constexpr std::array<std::array<int, 2>, 16> kCircle{{{0, -3},
                                                      {1, -3},
                                                      {2, -2},
                                                      {3, -1},
                                                      {3, 0},
                                                      {3, 1},
                                                      {2, 2},
                                                      {1, 3},
                                                      {0, 3},
                                                      {-1, 3},
                                                      {-2, 2},
                                                      {-3, 1},
                                                      {-3, 0},
                                                      {-3, -1},
                                                      {-2, -2},
                                                      {-1, -3}}};
using Offsets = std::array<std::ptrdiff_t, 16>;

// Many pixels at once, portably: compilers turn 32 into AVX2 or pairs of SSE, but on ARM compare those one by
// one.
#ifdef __ARM_NEON
constexpr int kLanes = 16;
#else
constexpr int kLanes = 32;
#endif
using U8 = std::uint8_t __attribute__((vector_size(kLanes)));

[[gnu::always_inline]] inline U8 load(const std::uint8_t* p) {
  U8 v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

[[gnu::always_inline]] inline U8 smaller(U8 a, U8 b) {
  return a < b ? a : b;
}
[[gnu::always_inline]] inline U8 larger(U8 a, U8 b) {
  return a > b ? a : b;
}
using Words = std::array<std::uint64_t, kLanes / 8>;
[[gnu::always_inline]] inline Words words_of(U8 v) {
  Words words;
  std::memcpy(words.data(), &v, sizeof words);
  return words;
}
[[gnu::always_inline]] inline bool any(U8 v) {
  std::uint64_t together = 0;
  for (const std::uint64_t word : words_of(v)) together |= word;
  return together != 0;
}

/// Of every nine in a row around the circle the least difference counts, and of all sixteen rows the largest:
/// the contrast up to which a pixel is a corner. Two neighbouring rows share eight, which are made from pairs
/// and fours.
[[gnu::always_inline]] inline U8 strongest_row(const std::array<U8, 16>& d) {
  std::array<U8, 8> two, four;
  for (std::size_t i = 0; i < 8; ++i) two[i] = smaller(d[2 * i + 1], d[(2 * i + 2) % 16]);
  for (std::size_t i = 0; i < 8; ++i) four[i] = smaller(two[i], two[(i + 1) % 8]);
  U8 best{};
  for (std::size_t i = 0; i < 8; ++i) {
    const U8 eight = smaller(four[i], four[(i + 2) % 8]);
    best = larger(best, smaller(eight, larger(d[2 * i], d[(2 * i + 9) % 16])));
  }
  return best;
}

/// Whether a row of nine can be there for any pixel: it covers four neighbours of the eight even points of
/// the circle. `difference` holds 0 where a point differs by no more than the threshold.
[[gnu::always_inline]] inline bool may_have_row(const std::array<U8, 8>& difference) {
  std::array<U8, 8> two;
  for (std::size_t i = 0; i < 8; ++i) two[i] = smaller(difference[i], difference[(i + 1) % 8]);
  U8 four{};
  for (std::size_t i = 0; i < 8; ++i) four |= smaller(two[i], two[(i + 2) % 8]);
  return any(four);
}

/// Above 0 where two neighbours of the circle's four outermost points differ: a row of nine covers two of
/// them.
[[gnu::always_inline]] inline U8 quarter_turn(const std::array<U8, 8>& difference) {
  return smaller(difference[0] | difference[4], difference[2] | difference[6]);
}

/// For each pixel of a group the contrast up to which it is a corner, or 0 where it is none at the threshold.
[[gnu::always_inline]] inline U8 corner_contrast(const std::uint8_t* p, const Offsets& o,
                                                 std::uint8_t threshold) {
  const U8 centre = load(p), t = U8{} + threshold;
  const U8 high = smaller(centre, ~t) + t, low = larger(centre, t) - t;  // saturated
  U8 contrast{};
  std::array<U8, 8> above, below;
  const auto compare = [&](std::size_t i) {
    const U8 q = load(p + o[2 * i]);
    above[i] = larger(q, high) - high;
    below[i] = low - smaller(q, low);
  };
  for (std::size_t i = 0; i < 8; i += 2) compare(i);
  if (!any(quarter_turn(above) | quarter_turn(below))) return contrast;
  for (std::size_t i = 1; i < 8; i += 2) compare(i);
  if (may_have_row(above)) {
    std::array<U8, 16> brighter;
    for (std::size_t i = 0; i < 16; ++i) brighter[i] = larger(load(p + o[i]), centre) - centre;
    contrast = strongest_row(brighter);
  }
  if (may_have_row(below)) {
    std::array<U8, 16> darker;
    for (std::size_t i = 0; i < 16; ++i) darker[i] = centre - smaller(load(p + o[i]), centre);
    contrast = larger(contrast, strongest_row(darker));
  }
  return contrast & reinterpret_cast<U8>(contrast > t);
}

/// 1 where a contrast of the middle row stands above its neighbours. Strictly above the earlier ones and not
/// below the later ones: of two equal neighbours one stays.
[[gnu::always_inline]] inline U8 peaks_of(const std::uint8_t* above, const std::uint8_t* here,
                                          const std::uint8_t* below) {
  const U8 earlier = larger(larger(load(above - 1), load(above)), larger(load(above + 1), load(here - 1)));
  const U8 later = larger(larger(load(below - 1), load(below)), larger(load(below + 1), load(here + 1)));
  const U8 c = load(here);
  return reinterpret_cast<U8>((c > earlier) & (c >= later)) & 1;
}

/// Where a parabola through three neighbours peaks, in 1/128 px from the middle one, which is above the
/// first.
std::int8_t peak_between(int before, int at, int after) {
  return static_cast<std::int8_t>(64 * (after - before) / (2 * at - before - after));
}

}  // namespace

STILLMAP_VECTOR_CLONES void fast_corners(ImageView<const std::uint8_t> image, int x0, int y0, int x1, int y1,
                                         int threshold, CellCorners& out) {
  Offsets offsets;
  for (std::size_t i = 0; i < 16; ++i) offsets[i] = kCircle[i][1] * image.stride + kCircle[i][0];
  constexpr int kMaxWidth = 128;
  STILLMAP_CHECK(x1 - x0 <= kMaxWidth);
  const auto width = static_cast<std::size_t>(x1 - x0);
  // Contrasts of three rows, x0 at index 1, with zeros on both sides: suppression looks at the row above once
  // the one below is known.
  using Row = std::array<std::uint8_t, kMaxWidth + kLanes + 2>;
  std::array<Row, 3> rows{};
  std::array<bool, 3> row_has_corner{};
  for (int y = y0; y <= y1; ++y) {
    const auto newest = static_cast<std::size_t>(y % 3), middle = (newest + 2) % 3, oldest = (newest + 1) % 3;
    U8 in_row{};
    for (std::size_t x = 0; x < width; x += kLanes) {
      // The last group may look at pixels beyond x1: inside the picture's memory, and their verdict is not
      // used.
      const U8 contrast =
          y < y1 ? corner_contrast(image.row(y) + x0 + x, offsets, static_cast<std::uint8_t>(threshold))
                 : U8{};
      in_row |= contrast;
      std::memcpy(&rows[newest][x + 1], &contrast, sizeof contrast);
    }
    std::memset(&rows[newest][width + 1], 0, kLanes);
    row_has_corner[newest] = any(in_row);
    if (y == y0 || !row_has_corner[middle]) continue;
    for (std::size_t x = 0; x < width; x += kLanes) {
      const U8 peaks = peaks_of(&rows[oldest][x + 1], &rows[middle][x + 1], &rows[newest][x + 1]);
      Words words = words_of(peaks);
      for (std::size_t word = 0; word < words.size(); ++word) {
        for (; words[word] != 0; words[word] &= words[word] - 1) {
          const std::size_t at = x + 8 * word + static_cast<std::size_t>(std::countr_zero(words[word])) / 8;
          const auto score = static_cast<std::uint8_t>(rows[middle][at + 1] - 1);
          const std::int8_t dx = peak_between(rows[middle][at], rows[middle][at + 1], rows[middle][at + 2]);
          const std::int8_t dy =
              peak_between(rows[oldest][at + 1], rows[middle][at + 1], rows[newest][at + 1]);
          if (!out.try_push_back({static_cast<std::int16_t>(x0 + static_cast<int>(at)),
                                  static_cast<std::int16_t>(y - 1), score, dx, dy}))
            return;
        }
      }
    }
  }
}

}  // namespace stillmap
