// SPDX-License-Identifier: Apache-2.0
#include "detect/network.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/dnn.hpp>

#include "tests/support/read_image.h"
#include "tests/support/shared_folder.h"

namespace stillmap {
namespace {

/// The real network's outputs on our kernels against those on OpenCV's. Both round alike but for ties, of
/// which the network has a handful.
TEST(Network, OnOurKernelsAgreesWithOpenCv) {
  STILLMAP_NEEDS_SHARED();
  const std::string file = test::shared_folder() / "models/nanodet_plus_m/nanodet_plus_m_int8.onnx";
  const test::Image<Bgr> colour =
      test::read_colour(test::shared_folder() / "data/fr1_rpy_walkers/rgb/1305031240.029620.jpg");
  cv::dnn::Net theirs = cv::dnn::readNetFromONNX(file);  // before ours takes its layers' place

  const InputFormat format{{103.53f, 116.28f, 123.675f}, {57.375f, 57.12f, 58.395f}};
  // A picture of the input's shape, so that there are no bars beside it.
  Network ours(Letterbox(640, 512, 320, 256), format);
  test::Image<Bgr> tall(640, 512);
  std::copy(colour.pixels.begin(), colour.pixels.end(), tall.pixels.begin());
  ASSERT_TRUE(ours.load(file).ok());
  const std::vector<std::string> names{"cls_8", "reg_8", "cls_64", "reg_64"};
  ASSERT_TRUE(ours.run(tall.view()).ok());
  std::vector<std::size_t> chosen;
  for (const std::string& name : names) {
    for (std::size_t i = 0; i < ours.output_count(); ++i) {
      if (ours.output(i).name == name) chosen.push_back(i);
    }
  }
  ASSERT_EQ(chosen.size(), names.size());
  ours.choose_outputs(chosen);
  ASSERT_TRUE(ours.run(tall.view()).ok());

  cv::Mat input(std::vector<int>{1, 3, 256, 320}, CV_32F);
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < 256; ++y) {
      for (int x = 0; x < 320; ++x) {
        const auto at = [&](int dx, int dy) {
          const Bgr& p = tall.view().at(2 * x + dx, 2 * y + dy);
          return c == 0 ? p.b : c == 1 ? p.g : p.r;
        };
        const int mean = (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1) + 2) >> 2;
        const auto channel = static_cast<std::size_t>(c);
        input.ptr<float>(0, c, y)[x] =
            (static_cast<float>(mean) - format.mean[channel]) / format.deviation[channel];
      }
    }
  }
  theirs.setInput(input);
  std::vector<cv::String> full;
  for (const std::string& name : names) full.push_back("onnx_node!deq_" + name);
  std::vector<cv::Mat> expected;
  theirs.forward(expected, full);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const Tensor found = ours.output(i);
    ASSERT_EQ(found.values.size(), expected[i].total()) << names[i];
    double difference = 0, size = 0;
    for (std::size_t k = 0; k < found.values.size(); ++k) {
      difference += std::abs(found.values[k] - expected[i].ptr<float>()[k]);
      size += std::abs(expected[i].ptr<float>()[k]);
    }
    EXPECT_LT(difference, 0.15 * size) << names[i];
  }
}

}  // namespace
}  // namespace stillmap
