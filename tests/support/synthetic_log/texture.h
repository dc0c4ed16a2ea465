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

/// All three bytes of a towards b by weight 0..256, two bytes per multiplication.
inline std::uint32_t blend(std::uint32_t a, std::uint32_t b, std::uint32_t weight) {
  const std::uint32_t rb = ((a & 0xff00ff) * (256 - weight) + (b & 0xff00ff) * weight) >> 8;
  const std::uint32_t g = ((a & 0x00ff00) * (256 - weight) + (b & 0x00ff00) * weight) >> 8;
  return (rb & 0xff00ff) | (g & 0x00ff00);
}

// In the header because it runs a million times per frame.
inline std::uint32_t Texture::sample(float u, float v, int level) const {
  const auto last = static_cast<int>(levels_.size()) - 1;
  const int l = level < 0 ? 0 : level > last ? last : level;
  const Level& from = levels_[static_cast<std::size_t>(l)];
  // Fixed point with 8 bits of fraction; the offset keeps it positive, so that a cast is a floor.
  const float scale = 256.0f / static_cast<float>(1 << l);
  const auto x = static_cast<std::int32_t>(u * scale) + (1 << 28) - 128;
  const auto y = static_cast<std::int32_t>(v * scale) + (1 << 28) - 128;
  const int x_mask = from.width - 1, y_mask = from.height - 1;
  const int x0 = (x >> 8) & x_mask, x1 = ((x >> 8) + 1) & x_mask;
  const std::uint32_t* top = from.texels.data() + ((y >> 8) & y_mask) * from.width;
  const std::uint32_t* bottom = from.texels.data() + (((y >> 8) + 1) & y_mask) * from.width;
  const auto wx = static_cast<std::uint32_t>(x & 255), wy = static_cast<std::uint32_t>(y & 255);
  return blend(blend(top[x0], top[x1], wx), blend(bottom[x0], bottom[x1], wx), wy);
}

}  // namespace stillmap::synthetic
