// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_log/texture.h"

#include <algorithm>
#include <cmath>

namespace stillmap::synthetic {

namespace {

std::uint32_t packed(Rgb c) {
  const auto byte = [](int v) { return static_cast<std::uint32_t>(std::clamp(v, 0, 255)); };
  return byte(c.r) | byte(c.g) << 8 | byte(c.b) << 16;
}

Rgb unpacked(std::uint32_t c) {
  return {static_cast<int>(c & 255), static_cast<int>((c >> 8) & 255), static_cast<int>((c >> 16) & 255)};
}

/// Noise in [-1, 1] that changes smoothly over `cell` texels and repeats with the texture.
class SmoothNoise {
 public:
  SmoothNoise(Random& random, int width, int height, int cell)
      : cell_(cell), columns_(std::max(1, width / cell)), rows_(std::max(1, height / cell)) {
    values_.resize(static_cast<std::size_t>(columns_ * rows_));
    for (double& v : values_) v = random.uniform(-1, 1);
  }
  double at(int x, int y) const {
    const double fx = static_cast<double>(x % cell_) / cell_, fy = static_cast<double>(y % cell_) / cell_;
    const double sx = fx * fx * (3 - 2 * fx), sy = fy * fy * (3 - 2 * fy);
    const int column = x / cell_, row = y / cell_;
    const double top = value(column, row) * (1 - sx) + value(column + 1, row) * sx;
    const double bottom = value(column, row + 1) * (1 - sx) + value(column + 1, row + 1) * sx;
    return top * (1 - sy) + bottom * sy;
  }

 private:
  double value(int column, int row) const {
    return values_[static_cast<std::size_t>((row % rows_) * columns_ + column % columns_)];
  }
  int cell_, columns_, rows_;
  std::vector<double> values_;
};

}  // namespace

Texture::Texture(int width, int height, Rgb colour) {
  levels_.push_back(
      {width, height,
       std::vector<std::uint32_t>(static_cast<std::size_t>(width) * static_cast<std::size_t>(height),
                                  packed(colour))});
}

void Texture::set(int x, int y, Rgb c) {
  Level& level = levels_[0];
  level.texels[static_cast<std::size_t>((y & (level.height - 1)) * level.width + (x & (level.width - 1)))] =
      packed(c);
}

Rgb Texture::get(int x, int y) const {
  const Level& level = levels_[0];
  return unpacked(level.texels[static_cast<std::size_t>((y & (level.height - 1)) * level.width +
                                                        (x & (level.width - 1)))]);
}

void Texture::rectangle(int x0, int y0, int x1, int y1, Rgb c) {
  for (int y = y0; y < y1; ++y) {
    for (int x = x0; x < x1; ++x) set(x, y, c);
  }
}

void Texture::disk(int x, int y, int radius, Rgb c) {
  for (int dy = -radius; dy <= radius; ++dy) {
    for (int dx = -radius; dx <= radius; ++dx) {
      if (dx * dx + dy * dy <= radius * radius) set(x + dx, y + dy, c);
    }
  }
}

void Texture::weather(Random& random, double amplitude, int coarsest_px, double speck_share) {
  std::vector<SmoothNoise> octaves;
  for (int cell = coarsest_px; cell >= 2; cell /= 4) octaves.emplace_back(random, width(), height(), cell);
  for (int y = 0; y < height(); ++y) {
    for (int x = 0; x < width(); ++x) {
      double noise = 0, share = 0.5;
      for (const SmoothNoise& octave : octaves) {
        noise += share * octave.at(x, y);
        share *= 0.7;
      }
      double factor = 1 + amplitude * noise;
      if (random.chance(speck_share)) factor *= random.uniform(0.5, 1.4);
      set(x, y, scaled(get(x, y), factor));
    }
  }
}

void Texture::print(Random& random, int x0, int y0, int x1, int y1, int letter_px, Rgb ink) {
  for (int y = y0; y + letter_px <= y1; y += letter_px * 2) {
    for (int x = x0; x + letter_px <= x1; x += letter_px) {
      if (random.chance(0.18)) continue;
      // A letter is a few strokes on a 3 x 4 raster.
      const int stroke = std::max(1, letter_px / 4);
      for (int cell = 0; cell < 12; ++cell) {
        const int left = x + (cell % 3) * stroke, top = y + (cell / 3) * stroke;
        if (random.chance(0.55)) rectangle(left, top, left + stroke, top + stroke, ink);
      }
    }
  }
}

void Texture::finish() {
  while (levels_.back().width > 1 && levels_.back().height > 1) {
    const Level& from = levels_.back();
    Level to{from.width / 2, from.height / 2, {}};
    to.texels.reserve(from.texels.size() / 4);
    for (int y = 0; y < to.height; ++y) {
      for (int x = 0; x < to.width; ++x) {
        const std::size_t i = static_cast<std::size_t>(2 * y * from.width + 2 * x);
        const std::size_t below = i + static_cast<std::size_t>(from.width);
        Rgb sum{2, 2, 2};
        for (std::uint32_t texel :
             {from.texels[i], from.texels[i + 1], from.texels[below], from.texels[below + 1]}) {
          const Rgb c = unpacked(texel);
          sum = {sum.r + c.r, sum.g + c.g, sum.b + c.b};
        }
        to.texels.push_back(packed({sum.r / 4, sum.g / 4, sum.b / 4}));
      }
    }
    levels_.push_back(std::move(to));
  }
}

}  // namespace stillmap::synthetic
