// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "tests/support/synthetic_log/random.h"

namespace stillmap::synthetic {

struct Rgb {
  int r = 0, g = 0, b = 0;
};
constexpr Rgb scaled(Rgb c, double s) {
  return {static_cast<int>(c.r * s), static_cast<int>(c.g * s), static_cast<int>(c.b * s)};
}

/// A picture that repeats in both directions, with smaller copies of itself for far surfaces. Sides are
/// powers of two.
class Texture {
 public:
  Texture(int width, int height, Rgb colour);

  int width() const { return levels_[0].width; }
  int height() const { return levels_[0].height; }
  /// Anything outside wraps around.
  void set(int x, int y, Rgb c);
  Rgb get(int x, int y) const;
  void rectangle(int x0, int y0, int x1, int y1, Rgb c);
  void disk(int x, int y, int radius, Rgb c);
  /// Multiplies by smooth noise of several scales (amplitude 0..1, coarsest cell in texels) and adds single
  /// specks.
  void weather(Random& random, double amplitude, int coarsest_px, double speck_share);
  /// Rows of small dark marks, as print looks from afar.
  void print(Random& random, int x0, int y0, int x1, int y1, int letter_px, Rgb ink);
  /// Must be called once, after drawing and before `sample`.
  void finish();

  /// The colour at (u, v) in texels of the full size, between neighbours, from the copy that is 2^level
  /// smaller. Bytes r, g, b from the lowest.
  std::uint32_t sample(float u, float v, int level) const;

 private:
  struct Level {
    int width = 0, height = 0;
    std::vector<std::uint32_t> texels;
  };
  std::vector<Level> levels_;
};

}  // namespace stillmap::synthetic
