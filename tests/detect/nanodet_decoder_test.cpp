// SPDX-License-Identifier: Apache-2.0
#include "detect/nanodet_decoder.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "tests/detect/reference_decode.h"

namespace stillmap {
namespace {

using test::decoder_setup;
using test::tensor_of;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr int kWidth = test::kInputWidth, kHeight = test::kInputHeight;

/// The outputs of a network of `classes` classes at 320x256, all of them "nothing here".
struct Outputs {
  explicit Outputs(std::size_t class_count) : classes(class_count) {
    for (const int stride : {8, 16, 32, 64}) {
      const std::size_t cells =
          static_cast<std::size_t>(kWidth / stride) * static_cast<std::size_t>(kHeight / stride);
      logits.emplace_back(class_count * cells, -20.f);
      bins.emplace_back(4u * 8 * cells, 0.f);
    }
  }
  std::vector<Tensor> tensors() const {
    static const std::vector<std::string> names{"cls_8",  "reg_8",  "cls_16", "reg_16",
                                                "cls_32", "reg_32", "cls_64", "reg_64"};
    std::vector<Tensor> list;
    for (std::size_t i = 0; i < 4; ++i) {
      const std::size_t rows = kHeight >> (3 + i), columns = kWidth >> (3 + i);
      list.push_back(tensor_of(names[2 * i], {1, classes, rows, columns}, logits[i]));
      list.push_back(tensor_of(names[2 * i + 1], {1, 32, rows, columns}, bins[i]));
    }
    return list;
  }
  std::size_t cell(std::size_t head, int column, int row) const {
    return static_cast<std::size_t>(row * (kWidth / (8 << head)) + column);
  }
  float& logit(std::size_t head, std::size_t id, int column, int row) {
    return logits[head][id * logits[head].size() / classes + cell(head, column, row)];
  }
  float& bin(std::size_t head, int side, int k, int column, int row) {
    return bins[head]
               [static_cast<std::size_t>(side * 8 + k) * bins[head].size() / 32 + cell(head, column, row)];
  }
  /// An object whose four sides lie the given whole numbers of strides from its cell.
  void put(std::size_t head, std::size_t id, int column, int row, float score_logit,
           std::array<int, 4> strides) {
    logit(head, id, column, row) = score_logit;
    for (int side = 0; side < 4; ++side)
      bin(head, side, strides[static_cast<std::size_t>(side)], column, row) = 40;
  }
  std::size_t classes;
  std::vector<std::vector<float>> logits, bins;
};

FixedVector<Detection, 64> decode(const Outputs& outputs, double score = 0.35, double iou = 0.6) {
  DecoderSetup setup = decoder_setup(static_cast<int>(outputs.classes), {});
  setup.score_threshold = score;
  NanodetDecoder decoder(setup, 0);
  return test::decode(decoder, setup.classes, outputs.tensors(), iou);
}

TEST(NanodetDecoder, FindsNothingInNothing) {
  EXPECT_TRUE(decode(Outputs(80)).empty());
}

TEST(NanodetDecoder, PutsABoxBackIntoThePicture) {
  Outputs outputs(3);
  outputs.put(1, 2, 10, 8, 2.0f, {1, 2, 3, 4});  // centre (160, 128) at stride 16: (144, 96) to (208, 192)
  const auto found = decode(outputs);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].class_id, 2);
  EXPECT_NEAR(found[0].score, 0.880797, 1e-5);
  EXPECT_NEAR(found[0].box.x0, 288, 1e-3);
  EXPECT_NEAR(found[0].box.y0, (96 - 8) * 2, 1e-3);
  EXPECT_NEAR(found[0].box.x1, 416, 1e-3);
  EXPECT_NEAR(found[0].box.y1, (192 - 8) * 2, 1e-3);
}

TEST(NanodetDecoder, SuppressesTheWeakerOfOneClassOnly) {
  Outputs outputs(2);
  outputs.put(0, 0, 20, 16, 1.0f, {4, 4, 4, 4});
  outputs.put(0, 0, 21, 16, 2.0f, {4, 4, 4, 4});  // overlap 7 / 9
  outputs.put(0, 1, 20, 17, 0.5f, {4, 4, 4, 4});  // another class
  outputs.put(0, 0, 25, 16, 0.4f, {4, 4, 4, 4});  // the same class, beside
  const auto found = decode(outputs);
  ASSERT_EQ(found.size(), 3u);
  EXPECT_GT(found[0].score, found[1].score);
  EXPECT_NEAR(found[0].box.x0, 2 * (21 * 8 - 32), 1e-3);
  EXPECT_EQ(found[1].class_id, 1);
  EXPECT_EQ(found[2].class_id, 0);
  EXPECT_EQ(decode(outputs, 0.35, 0.8).size(), 4u) << "an overlap below the threshold is no duplicate";
}

TEST(NanodetDecoder, ThresholdIsAScoreNotALogit) {
  Outputs outputs(1);
  outputs.put(0, 0, 5, 5, std::log(0.36f / 0.64f), {1, 1, 1, 1});
  EXPECT_EQ(decode(outputs, 0.35).size(), 1u);
  EXPECT_EQ(decode(outputs, 0.37).size(), 0u);
}

TEST(NanodetDecoder, ClipsAndDropsWhatLiesOutside) {
  Outputs outputs(1);
  outputs.put(2, 0, 0, 4, 1.0f, {7, 1, 7, 1});   // over the left edge
  outputs.put(0, 0, 20, 0, 1.0f, {1, 0, 1, 1});  // within the upper bar, beside the picture
  const auto found = decode(outputs);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].box.x0, 0);
  EXPECT_NEAR(found[0].box.x1, 2 * 7 * 32, 1e-3);
}

TEST(NanodetDecoder, NeverMakesABoxOfWhatIsNotANumber) {
  for (const float bad : {kNan, kInf, -kInf}) {
    Outputs outputs(2);
    for (auto& plane : outputs.logits) std::fill(plane.begin(), plane.end(), bad);
    for (auto& plane : outputs.bins) std::fill(plane.begin(), plane.end(), bad);
    EXPECT_TRUE(decode(outputs).empty());
  }
  for (const float bad : {kNan, kInf, -kInf}) {
    Outputs outputs(2);
    outputs.put(0, 1, 20, 16, bad, {2, 2, 2, 2});
    EXPECT_TRUE(decode(outputs).empty()) << bad;
  }
  for (const float bad : {kNan, kInf, -kInf}) {
    for (int k = 0; k < 8; ++k) {
      Outputs outputs(2);
      outputs.put(0, 1, 20, 16, 3.0f, {2, 2, 2, 2});
      outputs.bin(0, 3, k, 20, 16) = bad;
      EXPECT_TRUE(decode(outputs).empty()) << bad << " in bin " << k;
    }
  }
}

TEST(NanodetDecoder, SurvivesHugeNumbers) {
  Outputs outputs(2);
  outputs.put(0, 1, 20, 16, 3e38f, {2, 2, 2, 2});
  outputs.bin(0, 0, 7, 20, 16) = 3e38f;
  outputs.bin(0, 0, 0, 20, 16) = -3e38f;
  const auto found = decode(outputs);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].score, 1);
  EXPECT_NEAR(found[0].box.x0, 2 * (160 - 56), 1e-3);
}

TEST(NanodetDecoder, KeepsTheBestWhereThereAreTooMany) {
  Outputs outputs(1);
  // 1280 small boxes beside each other, better to the lower right: more than the candidates hold.
  for (int row = 0; row < 32; ++row) {
    for (int column = 0; column < 40; ++column) {
      outputs.put(0, 0, column, row, 0.001f * static_cast<float>(row * 40 + column), {0, 0, 1, 1});
    }
  }
  const auto found = decode(outputs);
  ASSERT_EQ(found.size(), 64u);
  for (std::size_t i = 1; i < found.size(); ++i) EXPECT_GE(found[i - 1].score, found[i].score);
  // Row 31 lies in the lower bar: the best 64 are rows 30, 29 from the right.
  EXPECT_NEAR(found[0].box.x0, 2 * 39 * 8, 1e-3);
  EXPECT_NEAR(found[0].box.y0, 2 * (30 * 8 - 8), 1e-3);
  EXPECT_NEAR(found[63].box.x0, 2 * 16 * 8, 1e-3);
  EXPECT_NEAR(found[63].box.y0, 2 * (29 * 8 - 8), 1e-3);
}

TEST(NanodetDecoder, PlanarAgreesWithTheReference) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    std::mt19937 random(seed);
    std::normal_distribution<float> logit(-5.5f, 1.5f), bin(0, 1.5f);
    Outputs outputs(20);
    for (auto& plane : outputs.logits)
      std::generate(plane.begin(), plane.end(), [&] { return logit(random); });
    for (auto& plane : outputs.bins) std::generate(plane.begin(), plane.end(), [&] { return bin(random); });
    NanodetDecoder decoder(decoder_setup(20, {8, 16, 32, 64}), 0);
    test::expect_as_reference("planar", decoder, 20, outputs.tensors());
  }
}

/// One output [1, cells, classes + 32] of random scores and bins.
std::vector<float> one_output(std::size_t cells, std::size_t classes) {
  std::mt19937 random(4);
  std::normal_distribution<float> logit(-5.5f, 1.5f), bin(0, 1.5f);
  std::vector<float> values;
  for (std::size_t i = 0; i < cells; ++i) {
    for (std::size_t k = 0; k < classes; ++k) values.push_back(1 / (1 + std::exp(-logit(random))));
    for (std::size_t k = 0; k < 32; ++k) values.push_back(bin(random));
  }
  return values;
}

TEST(NanodetDecoder, OneOutputAgreesWithTheReference) {
  const std::size_t three = 1280 + 320 + 80, four = three + 20;
  const std::vector<float> plus = one_output(four, 20), plain = one_output(three, 20);
  const std::vector<Tensor> plus_outputs{tensor_of("output", {1, four, 52}, plus)};
  const std::vector<Tensor> plain_outputs{tensor_of("output", {1, three, 52}, plain)};
  NanodetDecoder plus_decoder(decoder_setup(20, {8, 16, 32, 64}), 0);
  test::expect_as_reference("nanodet_plus", plus_decoder, 20, plus_outputs);
  NanodetDecoder plain_decoder(decoder_setup(20, {8, 16, 32}), 0.5f);
  test::expect_as_reference("nanodet", plain_decoder, 20, plain_outputs);
}

TEST(NanodetDecoder, TakesTheStridesThatTheNamesSay) {
  const Outputs outputs(2);
  const std::vector<Tensor> all = outputs.tensors();
  NanodetDecoder unsaid(decoder_setup(2, {}), 0), said(decoder_setup(2, {8, 16, 32, 64}), 0),
      wrong(decoder_setup(2, {8, 16, 32}), 0);
  EXPECT_THAT(unsaid.choose(std::span(all).subspan(4)).outputs, ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(said.choose(all).outputs, testing::SizeIs(8));
  EXPECT_THAT(wrong.choose(all).refusal,
              HasSubstr("[8, 16, 32, 64], not for detector.strides = [8, 16, 32]"));
}

TEST(NanodetDecoder, RefusesOneOutputThatDoesNotFit) {
  const std::vector<float> values(1680 * 52);
  const std::vector<Tensor> outputs{tensor_of("output", {1, 1680, 52}, values)};
  NanodetDecoder plus(decoder_setup(20, {8, 16, 32, 64}), 0), unsaid(decoder_setup(20, {}), 0),
      classes(decoder_setup(19, {8, 16, 32}), 0);
  EXPECT_THAT(plus.choose(outputs).refusal, HasSubstr("no output [1, 1700, 20], but [1, 1680, 52]"));
  EXPECT_THAT(unsaid.choose(outputs).refusal, HasSubstr("detector.strides"));
  EXPECT_THAT(classes.choose(outputs).refusal, HasSubstr("52 values a cell, where 19 classes"));
}

}  // namespace
}  // namespace stillmap
