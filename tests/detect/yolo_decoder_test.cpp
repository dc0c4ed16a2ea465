// SPDX-License-Identifier: Apache-2.0
#include "detect/yolo_decoder.h"

#include <gmock/gmock.h>

#include <cmath>
#include <random>

#include "tests/detect/reference_decode.h"

namespace stillmap {
namespace {

using test::decoder_setup;
using test::tensor_of;
using testing::HasSubstr;

constexpr std::size_t kCells = 1280 + 320 + 80, kClasses = 20;

/// Cell after cell: centre, size, and probabilities of which few are high.
std::vector<float> cells(std::size_t count, bool with_object) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> at(-20, 340), size(2, 120), probability(0, 1);
  std::vector<float> values;
  for (std::size_t i = 0; i < count; ++i) {
    for (int k = 0; k < 2; ++k) values.push_back(at(random));
    for (int k = 0; k < 2; ++k) values.push_back(size(random));
    if (with_object) values.push_back(std::pow(probability(random), 8.f));
    for (std::size_t k = 0; k < kClasses; ++k) values.push_back(std::pow(probability(random), 200.f));
  }
  return values;
}

TEST(YoloDecoder, Version5AgreesWithTheReference) {
  const std::vector<float> values = cells(3 * kCells, true);
  const std::vector<Tensor> outputs{tensor_of("output0", {1, 3 * kCells, 5 + kClasses}, values)};
  YoloDecoder decoder(decoder_setup(kClasses, {8, 16, 32}), YoloDecoder::Version::V5);
  test::expect_as_reference("yolov5", decoder, kClasses, outputs);
}

TEST(YoloDecoder, Version8AgreesWithTheReference) {
  const std::vector<float> by_cell = cells(kCells, false);
  std::vector<float> values(by_cell.size());
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i % (4 + kClasses) * kCells + i / (4 + kClasses)] = by_cell[i];
  const std::vector<Tensor> outputs{tensor_of("output0", {1, 4 + kClasses, kCells}, values)};
  YoloDecoder decoder(decoder_setup(kClasses, {8, 16, 32}), YoloDecoder::Version::V8);
  test::expect_as_reference("yolov8", decoder, kClasses, outputs);
}

TEST(YoloDecoder, FindsItsOutputAmongOthers) {
  const std::vector<float> values(3 * kCells * 6, 0.f);
  const std::vector<Tensor> outputs{tensor_of("raw", {1, 255, 32, 40}, values),
                                    {"five dimensions", 0, {}, {}},
                                    tensor_of("output0", {1, 3 * kCells, 6}, values)};
  YoloDecoder decoder(decoder_setup(1, {8, 16, 32}), YoloDecoder::Version::V5);
  EXPECT_THAT(decoder.choose(outputs).outputs, testing::ElementsAre(2));
}

TEST(YoloDecoder, RefusesTheOtherVersionsOutput) {
  const std::vector<float> values(3 * kCells * (5 + kClasses), 0.f);
  const std::vector<Tensor> five{tensor_of("output0", {1, 3 * kCells, 5 + kClasses}, values)};
  const std::vector<Tensor> eight{tensor_of("output0", {1, 4 + kClasses, kCells}, values)};
  YoloDecoder v5(decoder_setup(kClasses, {8, 16, 32}), YoloDecoder::Version::V5);
  YoloDecoder v8(decoder_setup(kClasses, {8, 16, 32}), YoloDecoder::Version::V8);
  EXPECT_THAT(v5.choose(eight).refusal, HasSubstr("no output [1, 5040, 25], but [1, 24, 1680]"));
  EXPECT_THAT(v8.choose(five).refusal, HasSubstr("no output [1, 24, 1680], but [1, 5040, 25]"));
}

YoloDecoder yolox(int classes) {
  return {decoder_setup(classes, {8, 16, 32}), YoloDecoder::Version::X};
}

TEST(YoloDecoder, XAgreesWithTheReference) {
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
  YoloDecoder decoder = yolox(kClasses);
  test::expect_as_reference("yolox", decoder, kClasses, outputs);
}

TEST(YoloDecoder, XRefusesAGridOfAnotherSize) {
  const std::vector<float> values(3549 * 85);
  const std::vector<Tensor> outputs{tensor_of("output", {1, 3549, 85}, values)};  // 416 x 416
  EXPECT_THAT(yolox(80).choose(outputs).refusal, HasSubstr("no output [1, 1680, 85], but [1, 3549, 85]"));
}

TEST(YoloDecoder, XNeverMakesABoxOfAnOverflow) {
  std::vector<float> values(kCells * 6, 0.f);
  for (const float log_size : {88.8f, 1e30f, std::nanf("")}) {
    const std::vector<float> cell{0, 0, log_size, 1, 1, 1};
    std::copy(cell.begin(), cell.end(), values.begin() + 600);
    const std::vector<Tensor> outputs{tensor_of("output", {1, kCells, 6}, values)};
    YoloDecoder decoder = yolox(1);
    EXPECT_TRUE(test::decode(decoder, 1, outputs).empty()) << log_size;
  }
}

}  // namespace
}  // namespace stillmap
