// SPDX-License-Identifier: Apache-2.0
#include "detect/int8_layers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/random.h"

namespace stillmap {
namespace {

std::vector<std::int8_t> noise(std::size_t count, std::uint64_t seed) {
  Random random(seed);
  std::vector<std::int8_t> values(count);
  for (std::int8_t& v : values) v = static_cast<std::int8_t>(random.below(256));
  return values;
}

TEST(MaxPool, IsTheLargestThatItsSquareSees) {
  const TensorShape in{3, 11, 142};
  const std::vector<std::int8_t> values = noise(in.size(), 1);
  for (const MaxPool pool : {MaxPool{3, 2, 1}, MaxPool{2, 2, 0}, MaxPool{5, 1, 2}, MaxPool{1, 3, 0}}) {
    const TensorShape shape = pool.shape_of(in);
    EXPECT_EQ(shape.width, (in.width + 2 * pool.pad - pool.size) / pool.stride + 1);
    std::vector<std::int8_t> out(shape.size());
    pool.run(in, values.data(), out.data());
    std::size_t at = 0;
    for (int c = 0; c < in.channels; ++c) {
      for (int y = 0; y < shape.height; ++y) {
        for (int x = 0; x < shape.width; ++x, ++at) {
          int largest = -128;
          for (int dy = 0; dy < pool.size; ++dy) {
            for (int dx = 0; dx < pool.size; ++dx) {
              const int from_y = y * pool.stride - pool.pad + dy, from_x = x * pool.stride - pool.pad + dx;
              if (from_y < 0 || from_x < 0 || from_y >= in.height || from_x >= in.width) continue;
              largest = std::max<int>(
                  largest, values[static_cast<std::size_t>((c * in.height + from_y) * in.width + from_x)]);
            }
          }
          ASSERT_EQ(out[at], largest) << pool.size << " " << c << " " << y << " " << x;
        }
      }
    }
  }
}

TEST(Doubling, InterpolatesBetweenTheMiddlesOfPixels) {
  const TensorShape in{2, 5, 71};
  const std::vector<std::int8_t> values = noise(in.size(), 2);
  const TensorShape shape = Doubling::shape_of(in);
  EXPECT_EQ(shape, (TensorShape{2, 10, 142}));
  std::vector<std::int8_t> out(shape.size());
  Doubling::run(in, values.data(), out.data());
  std::size_t at = 0;
  for (int c = 0; c < in.channels; ++c) {
    for (int y = 0; y < shape.height; ++y) {
      for (int x = 0; x < shape.width; ++x, ++at) {
        const double from_y = std::clamp((y + 0.5) / 2 - 0.5, 0.0, in.height - 1.0);
        const double from_x = std::clamp((x + 0.5) / 2 - 0.5, 0.0, in.width - 1.0);
        const int y0 = static_cast<int>(from_y), x0 = static_cast<int>(from_x);
        const auto value = [&](int dy, int dx) {
          const int row = std::min(y0 + dy, in.height - 1), column = std::min(x0 + dx, in.width - 1);
          return static_cast<double>(
              values[static_cast<std::size_t>((c * in.height + row) * in.width + column)]);
        };
        const double above = std::lerp(value(0, 0), value(0, 1), from_x - x0);
        const double below = std::lerp(value(1, 0), value(1, 1), from_x - x0);
        ASSERT_EQ(out[at], std::trunc(std::lerp(above, below, from_y - y0))) << c << " " << y << " " << x;
      }
    }
  }
}

TEST(Sum, RoundsHalvesAwayFromZeroAndCutsToEightBits) {
  const std::vector<std::int8_t> a = noise(5000, 3), b = noise(5000, 4);
  for (const Sum sum : {Sum{0.5f, 0.25f, 0}, Sum{1.7f, -0.4f, -20.3f}, Sum{0.5f, 0.5f, 0.5f}}) {
    std::vector<std::int8_t> out(a.size());
    sum.run(a.size(), a.data(), b.data(), out.data());
    for (std::size_t i = 0; i < a.size(); ++i) {
      const float exact = sum.a_factor * a[i] + sum.b_factor * b[i] + sum.offset;
      ASSERT_EQ(out[i], std::clamp(static_cast<int>(std::round(exact)), -128, 127)) << exact;
    }
  }
}

}  // namespace
}  // namespace stillmap
