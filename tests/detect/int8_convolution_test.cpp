// SPDX-License-Identifier: Apache-2.0
#include "detect/int8_convolution.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <string>

#ifdef __aarch64__
#include <sys/auxv.h>
#endif

namespace stillmap {
namespace {

struct Case {
  const char* name;
  Int8Convolution::Shape shape;
  int width, height;
};

/// The definition, pixel by pixel.
struct Plain {
  Case c;
  std::vector<std::int8_t> weights, in, lut;
  std::vector<std::int32_t> bias;
  std::vector<float> multiplier;
  int in_zero = -17, out_zero = 5;

  Plain(const Case& which, int least_weight) : c(which) {
    std::mt19937 random(7);
    const Int8Convolution::Shape& s = c.shape;
    const int inputs = s.depthwise ? 1 : s.in_channels, taps = inputs * s.kernel_width * s.kernel_height;
    const auto fill = [&](std::vector<std::int8_t>& v, int count, int least) {
      v.resize(static_cast<std::size_t>(count));
      // The ends of the range, too: a sum that does not hold them would show.
      for (std::int8_t& x : v) {
        const int value = random() % 4 == 0 ? -128 : static_cast<int>(random() % 256) - 128;
        x = static_cast<std::int8_t>(std::max(value, least));
      }
    };
    fill(weights, s.out_channels * taps, least_weight);
    fill(in, s.in_channels * c.width * c.height, -128);
    fill(lut, 256, -128);
    for (int o = 0; o < s.out_channels; ++o) {
      bias.push_back(static_cast<std::int32_t>(random() % 20001) - 10000);
      multiplier.push_back(1 /
                           (60 * std::sqrt(static_cast<float>(taps)) * static_cast<float>(1 + random() % 4)));
    }
  }

  int at(int channel, int y, int x) const {
    if (x < 0 || y < 0 || x >= c.width || y >= c.height) return in_zero;
    return in[static_cast<std::size_t>((channel * c.height + y) * c.width + x)];
  }

  std::vector<std::int8_t> run(bool activation) const {
    const Int8Convolution::Shape& s = c.shape;
    std::vector<std::int8_t> out;
    const int inputs = s.depthwise ? 1 : s.in_channels;
    for (int o = 0; o < s.out_channels; ++o) {
      for (int y = -s.pad_y; y + s.kernel_height <= c.height + s.pad_y; y += s.stride) {
        for (int x = -s.pad_x; x + s.kernel_width <= c.width + s.pad_x; x += s.stride) {
          int sum = bias[static_cast<std::size_t>(o)];
          const std::int8_t* w =
              weights.data() + static_cast<std::ptrdiff_t>(o) * inputs * s.kernel_height * s.kernel_width;
          for (int k = 0; k < inputs; ++k)
            for (int ky = 0; ky < s.kernel_height; ++ky)
              for (int kx = 0; kx < s.kernel_width; ++kx)
                sum += *w++ * at(s.depthwise ? o : k, y + ky, x + kx);
          const float value = static_cast<float>(sum) * multiplier[static_cast<std::size_t>(o)];
          const int cut = std::clamp(static_cast<int>(std::nearbyint(value)) + out_zero, -128, 127);
          out.push_back(activation ? lut[static_cast<std::size_t>(cut + 128)]
                                   : static_cast<std::int8_t>(cut));
        }
      }
    }
    return out;
  }
};

class EveryKernel : public ::testing::TestWithParam<Case> {};

void expect_bytes_of_the_definition(const Plain& plain, bool activation) {
  const std::vector<std::int8_t> expected = plain.run(activation);
  ASSERT_GT(std::count_if(expected.begin(), expected.end(), [](int v) { return std::abs(v) < 100; }), 0);
  for (const Int8Kernels* kernels : int8_kernels()) {
    Int8Convolution convolution(*kernels, plain.c.shape, plain.weights, plain.bias, plain.multiplier,
                                plain.in_zero, plain.out_zero);
    if (activation) convolution.set_lut(plain.lut);
    const int width = convolution.out_width(plain.c.width), height = convolution.out_height(plain.c.height);
    ASSERT_EQ(expected.size(), static_cast<std::size_t>(plain.c.shape.out_channels * width * height));
    std::vector<std::int8_t> out(expected.size() + 64, std::int8_t{99});
    std::vector<std::byte> scratch(convolution.scratch_bytes(plain.c.width, plain.c.height));
    convolution.run(plain.in.data(), plain.c.width, plain.c.height, out.data(), scratch);
    EXPECT_TRUE(std::equal(expected.begin(), expected.end(), out.begin())) << kernels->name;
    EXPECT_EQ(std::count(out.begin() + static_cast<std::ptrdiff_t>(expected.size()), out.end(), 99), 64)
        << kernels->name << " writes beyond its output";
  }
}

TEST_P(EveryKernel, GivesTheBytesOfTheDefinition) {
  // Kernels may be quicker where no weight is -128.
  for (const int least_weight : {-128, -127}) {
    const Plain plain(GetParam(), least_weight);
    for (const bool activation : {false, true}) expect_bytes_of_the_definition(plain, activation);
  }
}

// in, out, kernel width and height, stride, pads, depthwise; width and height of the input.
const Case kCases[] = {
    {"pointwise", {58, 58, 1, 1, 1, 0, 0, false}, 40, 32},
    {"pointwise_odd", {7, 9, 1, 1, 1, 0, 0, false}, 5, 3},
    {"pointwise_one", {1, 1, 1, 1, 1, 0, 0, false}, 1, 1},
    {"first_layer", {3, 24, 3, 3, 2, 1, 1, false}, 64, 50},
    {"dense_wide", {5, 6, 5, 3, 1, 2, 0, false}, 13, 11},
    {"dense_strided_pointwise", {6, 4, 1, 1, 2, 0, 0, false}, 13, 12},
    {"dense_stride_8", {1, 2, 9, 9, 8, 4, 4, false}, 40, 24},
    {"depthwise_3", {5, 5, 3, 3, 1, 1, 1, true}, 33, 7},
    {"depthwise_3_strided", {4, 4, 3, 3, 2, 1, 1, true}, 33, 22},
    {"depthwise_5", {6, 6, 5, 5, 1, 2, 2, true}, 40, 32},
    {"depthwise_5_small", {3, 3, 5, 5, 1, 2, 2, true}, 5, 4},
    {"depthwise_5_strided", {3, 3, 5, 5, 2, 2, 2, true}, 19, 16},
    {"depthwise_7", {2, 2, 7, 7, 1, 3, 3, true}, 18, 9},
    {"depthwise_oblong_third", {2, 2, 5, 1, 3, 2, 0, true}, 31, 10},
    {"depthwise_unpadded", {2, 2, 3, 3, 1, 0, 0, true}, 17, 9},
};
INSTANTIATE_TEST_SUITE_P(Int8Convolution, EveryKernel, ::testing::ValuesIn(kCases),
                         [](const auto& test) { return std::string(test.param.name); });

TEST(Int8Convolution, SumsAsLargeAsTheyCanBeDoNotOverflow) {
  const int depth = 65536;
  const std::vector<std::int8_t> in(static_cast<std::size_t>(depth), std::int8_t{-128});
  for (const int weight : {-128, -127}) {
    const std::vector<std::int8_t> weights(in.size(), static_cast<std::int8_t>(weight));
    const std::vector<std::int32_t> bias{depth * 128 * (weight + 1)};
    const std::vector<float> multiplier{1.f / (depth * 128 / 64)};
    for (const Int8Kernels* kernels : int8_kernels()) {
      const Int8Convolution convolution(*kernels, {depth, 1}, weights, bias, multiplier, 0, 0);
      std::int8_t out = 0;
      std::vector<std::byte> scratch(convolution.scratch_bytes(1, 1));
      convolution.run(in.data(), 1, 1, &out, scratch);
      EXPECT_EQ(out, 64) << kernels->name;
    }
  }
}

#ifdef __aarch64__
TEST(Int8Convolution, TakesDotProductsWhereTheProcessorHasThem) {
  const bool has = (getauxval(AT_HWCAP) & HWCAP_ASIMDDP) != 0;
  EXPECT_EQ(int8_kernels().size(), has ? 2u : 1u);
  EXPECT_STREQ(int8_kernels().front()->name, has ? "dot products" : "generic");
}
#endif

TEST(Int8Convolution, SaysWhatItCannotDo) {
  EXPECT_TRUE(Int8Convolution::can({8, 8, 3, 3, 1, 1, 1, false}));
  EXPECT_FALSE(Int8Convolution::can({8, 16, 3, 3, 1, 1, 1, true})) << "two outputs for each input";
  EXPECT_FALSE(Int8Convolution::can({8, 8, 9, 9, 1, 4, 4, true})) << "more weights than the table holds";
  EXPECT_FALSE(Int8Convolution::can({65537, 8})) << "sums could overflow";
  EXPECT_FALSE(Int8Convolution::can({8, 8, 3, 3, 0, 1, 1, false}));
}

}  // namespace
}  // namespace stillmap
