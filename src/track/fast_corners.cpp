// SPDX-License-Identifier: Apache-2.0
#include "track/fast_corners.h"

#include <algorithm>
#include <array>
#include <cstring>

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

// Sixteen pixels at once, portably: GCC and Clang turn this into SSE or NEON.
using U8x16 = std::uint8_t __attribute__((vector_size(16)));

U8x16 load(const std::uint8_t* p) {
  U8x16 v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

U8x16 smaller(U8x16 a, U8x16 b) {
  return a < b ? a : b;
}
U8x16 larger(U8x16 a, U8x16 b) {
  return a > b ? a : b;
}
bool any(U8x16 v) {
  std::array<std::uint64_t, 2> halves;
  std::memcpy(halves.data(), &v, sizeof halves);
  return (halves[0] | halves[1]) != 0;
}

/// Of every nine in a row around the circle the least difference counts, and of all sixteen rows the largest:
/// the contrast up to which a pixel is a corner. Rows of nine are made from rows of two, four and eight.
U8x16 strongest_row(const std::array<U8x16, 16>& d) {
  std::array<U8x16, 16> two, four;
  for (std::size_t i = 0; i < 16; ++i) two[i] = smaller(d[i], d[(i + 1) % 16]);
  for (std::size_t i = 0; i < 16; ++i) four[i] = smaller(two[i], two[(i + 2) % 16]);
  U8x16 best{};
  for (std::size_t i = 0; i < 16; ++i) {
    best = larger(best, smaller(smaller(four[i], four[(i + 4) % 16]), d[(i + 8) % 16]));
  }
  return best;
}

/// For sixteen pixels the contrast up to which each is a corner, or zeros where none is one at the threshold.
U8x16 corner_contrast(const std::uint8_t* p, const Offsets& o, std::uint8_t threshold) {
  const U8x16 centre = load(p), t = U8x16{} + threshold;
  U8x16 high = centre + t, low = centre - t;
  high |= reinterpret_cast<U8x16>(high < centre);  // saturate
  low &= reinterpret_cast<U8x16>(low <= centre);
  // Nine in a row always cover two neighbouring compass points, which rejects most pixels at once.
  const U8x16 n = load(p + o[0]), e = load(p + o[4]), s = load(p + o[8]), w = load(p + o[12]);
  const auto bright = ((n > high) | (s > high)) & ((e > high) | (w > high));
  const auto dark = ((n < low) | (s < low)) & ((e < low) | (w < low));
  if (!any(reinterpret_cast<U8x16>(bright | dark))) return U8x16{};
  std::array<U8x16, 16> brighter, darker;
  for (std::size_t i = 0; i < 16; ++i) {
    const U8x16 q = load(p + o[i]);
    brighter[i] = larger(q, centre) - centre;
    darker[i] = larger(q, centre) - q;
  }
  const U8x16 contrast = larger(strongest_row(brighter), strongest_row(darker));
  return contrast & reinterpret_cast<U8x16>(contrast > t);
}

}  // namespace

void fast_corners(ImageView<const std::uint8_t> image, int x0, int y0, int x1, int y1, int threshold,
                  CellCorners& out) {
  Offsets offsets;
  for (std::size_t i = 0; i < 16; ++i) offsets[i] = kCircle[i][1] * image.stride + kCircle[i][0];
  constexpr int kMaxWidth = 128;
  STILLMAP_CHECK(x1 - x0 <= kMaxWidth);
  // Scores of three rows, with a border of zeros: suppression looks at the row above once the one below is
  // known.
  std::array<std::array<std::uint8_t, kMaxWidth + 2>, 3> scores{};
  std::array<bool, 3> row_has_corner{};
  for (int y = y0; y <= y1; ++y) {
    auto& row_scores = scores[static_cast<std::size_t>(y % 3)];
    bool& row_any = row_has_corner[static_cast<std::size_t>(y % 3)];
    row_scores.fill(0);
    row_any = false;
    for (int x = x0; y < y1 && x < x1; x += 16) {
      // The last group may look at pixels beyond x1: inside the picture's rows, and their verdict is not
      // used.
      const std::uint8_t* p = image.row(y) + x;
      const U8x16 contrast = corner_contrast(p, offsets, static_cast<std::uint8_t>(threshold));
      if (!any(contrast)) continue;
      for (int i = 0; i < 16 && x + i < x1; ++i) {
        if (contrast[i] == 0) continue;
        row_scores[static_cast<std::size_t>(x + i - x0 + 1)] = static_cast<std::uint8_t>(contrast[i] - 1);
        row_any = true;
      }
    }
    if (y == y0) continue;
    const auto& above = scores[static_cast<std::size_t>((y + 1) % 3)];  // y - 2
    const auto& here = scores[static_cast<std::size_t>((y + 2) % 3)];   // y - 1
    if (!row_has_corner[static_cast<std::size_t>((y + 2) % 3)]) continue;
    for (int x = x0; x < x1; ++x) {
      const auto i = static_cast<std::size_t>(x - x0 + 1);
      const std::uint8_t s = here[i];
      // Strictly above the earlier neighbours and not below the later ones: of two equal neighbours one
      // stays.
      if (s == 0 || s <= above[i - 1] || s <= above[i] || s <= above[i + 1] || s <= here[i - 1] ||
          s < here[i + 1] || s < row_scores[i - 1] || s < row_scores[i] || s < row_scores[i + 1]) {
        continue;
      }
      if (!out.try_push_back({static_cast<std::int16_t>(x), static_cast<std::int16_t>(y - 1), s})) return;
    }
  }
}

}  // namespace stillmap
