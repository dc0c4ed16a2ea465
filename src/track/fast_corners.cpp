// SPDX-License-Identifier: Apache-2.0
#include "track/fast_corners.h"

#include <algorithm>
#include <array>
#include <cstring>

namespace stillmap {

namespace {

/// The Bresenham circle of radius 3, clockwise from the top.
constexpr std::array<std::array<int, 2>, 16> kCircle{{{0, -3}, {1, -3}, {2, -2}, {3, -1}, {3, 0}, {3, 1}, {2, 2}, {1, 3},
                                                      {0, 3}, {-1, 3}, {-2, 2}, {-3, 1}, {-3, 0}, {-3, -1}, {-2, -2}, {-1, -3}}};
using Offsets = std::array<std::ptrdiff_t, 16>;

// Sixteen pixels at once, portably: GCC and Clang turn this into SSE or NEON.
using U8x16 = std::uint8_t __attribute__((vector_size(16)));

U8x16 load(const std::uint8_t* p) {
  U8x16 v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

/// Non-zero where a pixel may be a corner: nine of sixteen in a row always cover two neighbouring compass points.
U8x16 may_be_corner(const std::uint8_t* p, const Offsets& o, std::uint8_t threshold) {
  const U8x16 centre = load(p), t = U8x16{} + threshold;
  U8x16 high = centre + t, low = centre - t;
  high |= reinterpret_cast<U8x16>(high < centre);  // saturate
  low &= reinterpret_cast<U8x16>(low <= centre);
  const U8x16 n = load(p + o[0]), e = load(p + o[4]), s = load(p + o[8]), w = load(p + o[12]);
  const auto bright = ((n > high) | (s > high)) & ((e > high) | (w > high));
  const auto dark = ((n < low) | (s < low)) & ((e < low) | (w < low));
  return reinterpret_cast<U8x16>(bright | dark);
}

bool nine_in_a_row(std::uint32_t bits) {
  const std::uint32_t ring = bits | bits << 16;
  std::uint32_t run = ring & ring >> 1;
  run &= run >> 2;
  run &= run >> 4;
  return (run & ring >> 8 & 0xffff) != 0;
}

/// The largest threshold that keeps the corner, or 0 where `threshold` does not.
int corner_score(const std::uint8_t* p, const Offsets& o, int threshold) {
  std::array<int, 25> difference;
  std::uint32_t bright = 0, dark = 0;
  for (std::size_t i = 0; i < 16; ++i) {
    difference[i] = p[o[i]] - p[0];
    bright |= static_cast<std::uint32_t>(difference[i] > threshold) << i;
    dark |= static_cast<std::uint32_t>(difference[i] < -threshold) << i;
  }
  const bool is_bright = nine_in_a_row(bright);
  if (!is_bright && !nine_in_a_row(dark)) return 0;
  if (!is_bright) {
    for (std::size_t i = 0; i < 16; ++i) difference[i] = -difference[i];
  }
  std::copy_n(difference.begin(), 9, difference.begin() + 16);
  int best = 0;
  for (std::size_t start = 0; start < 16; ++start) {
    const auto first = difference.begin() + static_cast<std::ptrdiff_t>(start);
    best = std::max(best, *std::min_element(first, first + 9));
  }
  return best - 1;
}

}  // namespace

void fast_corners(ImageView<const std::uint8_t> image, int x0, int y0, int x1, int y1, int threshold, CellCorners& out) {
  Offsets offsets;
  for (std::size_t i = 0; i < 16; ++i) offsets[i] = kCircle[i][1] * image.stride + kCircle[i][0];
  constexpr int kMaxWidth = 128;
  STILLMAP_CHECK(x1 - x0 <= kMaxWidth);
  // Scores of three rows, with a border of zeros: suppression looks at the row above once the one below is known.
  std::array<std::array<std::uint8_t, kMaxWidth + 2>, 3> scores{};
  std::array<bool, 3> any{};
  for (int y = y0; y <= y1; ++y) {
    auto& row_scores = scores[static_cast<std::size_t>(y % 3)];
    bool& row_any = any[static_cast<std::size_t>(y % 3)];
    row_scores.fill(0);
    row_any = false;
    for (int x = x0; y < y1 && x < x1; x += 16) {
      // The last group may look at pixels beyond x1: inside the picture's rows, and their verdict is not used.
      const std::uint8_t* p = image.row(y) + x;
      const U8x16 candidates = may_be_corner(p, offsets, static_cast<std::uint8_t>(threshold));
      std::array<std::uint64_t, 2> halves;
      std::memcpy(halves.data(), &candidates, sizeof halves);
      if ((halves[0] | halves[1]) == 0) continue;
      for (int i = 0; i < 16 && x + i < x1; ++i) {
        if (candidates[i] == 0) continue;
        const int score = corner_score(p + i, offsets, threshold);
        row_scores[static_cast<std::size_t>(x + i - x0 + 1)] = static_cast<std::uint8_t>(score);
        row_any |= score > 0;
      }
    }
    if (y == y0) continue;
    const auto& above = scores[static_cast<std::size_t>((y + 1) % 3)];  // y - 2
    const auto& here = scores[static_cast<std::size_t>((y + 2) % 3)];   // y - 1
    if (!any[static_cast<std::size_t>((y + 2) % 3)]) continue;
    for (int x = x0; x < x1; ++x) {
      const auto i = static_cast<std::size_t>(x - x0 + 1);
      const std::uint8_t s = here[i];
      // Strictly above the earlier neighbours and not below the later ones: of two equal neighbours one stays.
      if (s == 0 || s <= above[i - 1] || s <= above[i] || s <= above[i + 1] || s <= here[i - 1] || s < here[i + 1] ||
          s < row_scores[i - 1] || s < row_scores[i] || s < row_scores[i + 1]) {
        continue;
      }
      if (!out.try_push_back({static_cast<std::int16_t>(x), static_cast<std::int16_t>(y - 1), s})) return;
    }
  }
}

}  // namespace stillmap
