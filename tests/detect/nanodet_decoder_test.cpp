// SPDX-License-Identifier: Apache-2.0
#include "detect/nanodet_decoder.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

namespace stillmap {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr int kWidth = 320, kHeight = 256;

/// The outputs of a network of `classes` classes at 320x256, all of them "nothing here".
struct Outputs {
  explicit Outputs(std::size_t class_count) : classes(class_count) {
    for (const int stride : {8, 16, 32, 64}) {
      const std::size_t cells =
          static_cast<std::size_t>(kWidth / stride) * static_cast<std::size_t>(kHeight / stride);
      logits.emplace_back(class_count * cells, -20.f);
      bins.emplace_back(4u * NanodetDecoder::kBins * cells, 0.f);
    }
  }
  std::vector<NanodetDecoder::Head> heads() const {
    std::vector<NanodetDecoder::Head> h;
    for (std::size_t i = 0; i < 4; ++i) {
      const int stride = 8 << i;
      h.push_back({stride, kWidth / stride, kHeight / stride, logits[i], bins[i]});
    }
    return h;
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
  const std::vector<ClassKind> kinds(outputs.classes, ClassKind::Dynamic);
  NanodetDecoder decoder(kinds, score, iou);
  FixedVector<Detection, 64> found;
  decoder.decode(outputs.heads(), Letterbox(640, 480, kWidth, kHeight), found);
  return found;
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

/// What reference_decode.py says of the outputs; nothing where there is no Python with numpy.
std::vector<Detection> decode_by_reference(const Outputs& outputs) {
  const std::filesystem::path file =
      std::filesystem::temp_directory_path() / ("stillmap_logits_" + std::to_string(getpid()));
  std::ofstream out(file, std::ios::binary);
  for (std::size_t i = 0; i < 4; ++i) {
    for (const auto* plane : {&outputs.logits[i], &outputs.bins[i]}) {
      out.write(reinterpret_cast<const char*>(plane->data()),
                static_cast<std::streamsize>(plane->size() * 4));
    }
  }
  out.close();
  const std::string command = "/usr/bin/python3 " STILLMAP_SOURCE_DIR "/tests/detect/reference_decode.py " +
                              file.string() + " " + std::to_string(outputs.classes) +
                              " 640 480 320 256 0.35 0.6";
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe(popen(command.c_str(), "r"), pclose);
  std::vector<Detection> found;
  for (Detection d; std::fscanf(pipe.get(), "%hu %f %f %f %f %f", &d.class_id, &d.score, &d.box.x0, &d.box.y0,
                                &d.box.x1, &d.box.y1) == 6;) {
    found.push_back(d);
  }
  std::filesystem::remove(file);
  return found;
}

TEST(NanodetDecoder, AgreesWithTheReference) {
  if (std::system("/usr/bin/python3 -c 'import numpy' 2>/dev/null") != 0)
    GTEST_SKIP() << "needs python3-numpy";
  for (unsigned seed = 1; seed <= 5; ++seed) {
    std::mt19937 random(seed);
    std::normal_distribution<float> logit(-5.5f, 1.5f), bin(0, 1.5f);
    Outputs outputs(20);
    for (auto& plane : outputs.logits)
      std::generate(plane.begin(), plane.end(), [&] { return logit(random); });
    for (auto& plane : outputs.bins) std::generate(plane.begin(), plane.end(), [&] { return bin(random); });
    const auto found = decode(outputs);
    const std::vector<Detection> expected = decode_by_reference(outputs);
    ASSERT_GT(expected.size(), 10u);
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t i = 0; i < expected.size(); ++i) {
      EXPECT_EQ(found[i].class_id, expected[i].class_id);
      EXPECT_NEAR(found[i].score, expected[i].score, 1e-5);
      EXPECT_NEAR(found[i].box.x0, expected[i].box.x0, 0.01);
      EXPECT_NEAR(found[i].box.y0, expected[i].box.y0, 0.01);
      EXPECT_NEAR(found[i].box.x1, expected[i].box.x1, 0.01);
      EXPECT_NEAR(found[i].box.y1, expected[i].box.y1, 0.01);
    }
  }
}

TEST(IntersectionOverUnion, OfKnownBoxes) {
  const Box a{0, 0, 10, 10};
  EXPECT_FLOAT_EQ(intersection_over_union(a, a), 1);
  EXPECT_FLOAT_EQ(intersection_over_union(a, {5, 0, 15, 10}), 50.f / 150.f);
  EXPECT_EQ(intersection_over_union(a, {10, 0, 20, 10}), 0);
  EXPECT_EQ(intersection_over_union({}, {}), 0);
}

}  // namespace
}  // namespace stillmap
