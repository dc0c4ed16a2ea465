// SPDX-License-Identifier: Apache-2.0
#include "detect/yolox_decoder.h"

#include <gmock/gmock.h>

#include <cmath>
#include <random>

#include "tests/detect/reference_decode.h"

namespace stillmap {
namespace {

using test::decoder_setup;
using test::tensor_of;

constexpr std::size_t kCells = 1280 + 320 + 80, kClasses = 20;

TEST(YoloxDecoder, AgreesWithTheReference) {
  std::mt19937 random(9);
  std::uniform_real_distribution<float> at(-0.5f, 1.5f), log_size(-0.5f, 1.5f), probability(0, 1);
  std::vector<float> values;
  for (std::size_t i = 0; i < kCells; ++i) {
    for (int k = 0; k < 2; ++k) values.push_back(at(random));
    for (int k = 0; k < 2; ++k) values.push_back(log_size(random));
    values.push_back(std::pow(probability(random), 4.f));
    for (std::size_t k = 0; k < kClasses; ++k) values.push_back(std::pow(probability(random), 100.f));
  }
  const std::vector<Tensor> outputs{tensor_of("output", {1, kCells, 5 + kClasses}, values)};
  YoloxDecoder decoder(decoder_setup(kClasses, {8, 16, 32}));
  test::expect_as_reference("yolox", decoder, kClasses, outputs);
}

TEST(YoloxDecoder, RefusesAGridOfAnotherSize) {
  const std::vector<float> values(3549 * 85);
  const std::vector<Tensor> outputs{tensor_of("output", {1, 3549, 85}, values)};  // 416 x 416
  YoloxDecoder decoder(decoder_setup(80, {8, 16, 32}));
  EXPECT_THAT(decoder.choose(outputs).refusal,
              testing::HasSubstr("no output [1, 1680, 85], but [1, 3549, 85]"));
}

TEST(YoloxDecoder, NeverMakesABoxOfAnOverflow) {
  std::vector<float> values(kCells * 6, 0.f);
  for (const float log_size : {88.8f, 1e30f, std::nanf("")}) {
    const std::vector<float> cell{0, 0, log_size, 1, 1, 1};
    std::copy(cell.begin(), cell.end(), values.begin() + 600);
    const std::vector<Tensor> outputs{tensor_of("output", {1, kCells, 6}, values)};
    YoloxDecoder decoder(decoder_setup(1, {8, 16, 32}));
    EXPECT_TRUE(test::decode(decoder, 1, outputs).empty()) << log_size;
  }
}

}  // namespace
}  // namespace stillmap
