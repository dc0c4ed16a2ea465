// SPDX-License-Identifier: Apache-2.0
#include "detect/picture_scaler.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "core/random.h"
#include "tests/support/read_image.h"

namespace stillmap {
namespace {

test::Image<Bgr> noise(int width, int height) {
  Random random(7);
  test::Image<Bgr> picture(width, height);
  for (Bgr& p : picture.pixels) {
    const std::uint64_t word = random.next();
    p = {static_cast<std::uint8_t>(word), static_cast<std::uint8_t>(word >> 8),
         static_cast<std::uint8_t>(word >> 16)};
  }
  return picture;
}

/// The largest difference from OpenCV's scaling.
int difference(int from_width, int from_height, int to_width, int to_height, int interpolation) {
  test::Image<Bgr> from = noise(from_width + 3, from_height);
  const ImageView<const Bgr> part{from.pixels.data() + 2, from_width, from_height, from_width + 3};
  const cv::Mat whole(from.height, from.width, CV_8UC3, from.pixels.data());
  cv::Mat expected;
  cv::resize(whole(cv::Rect(2, 0, from_width, from_height)), expected, {to_width, to_height}, 0, 0,
             interpolation);
  PictureScaler scaler(from_width, from_height, to_width, to_height);
  std::vector<Bgr> row(static_cast<std::size_t>(to_width));
  int largest = 0;
  for (int y = 0; y < to_height; ++y) {
    scaler.row(part, y, row);
    for (int x = 0; x < to_width; ++x) {
      const auto& e = expected.at<cv::Vec3b>(y, x);
      const Bgr& p = row[static_cast<std::size_t>(x)];
      largest = std::max({largest, std::abs(p.b - e[0]), std::abs(p.g - e[1]), std::abs(p.r - e[2])});
    }
  }
  return largest;
}

TEST(PictureScaler, ShrinksByWholePixelsAsOpenCvDoes) {
  EXPECT_EQ(difference(640, 480, 320, 240, cv::INTER_AREA), 0);
  EXPECT_EQ(difference(1280, 960, 320, 240, cv::INTER_AREA), 0);
  EXPECT_EQ(difference(960, 720, 320, 240, cv::INTER_AREA), 0);
}

TEST(PictureScaler, InterpolatesAsOpenCvDoes) {
  EXPECT_EQ(difference(540, 360, 320, 213, cv::INTER_LINEAR), 0);
  EXPECT_EQ(difference(320, 240, 416, 312, cv::INTER_LINEAR), 0);
  EXPECT_EQ(difference(320, 256, 320, 256, cv::INTER_LINEAR), 0);
}

TEST(PictureScaler, ShrinksByPartsOfPixelsAsOpenCvDoesWithinALevel) {
  EXPECT_LE(difference(848, 480, 320, 181, cv::INTER_AREA), 1);
  EXPECT_LE(difference(1920, 1080, 416, 234, cv::INTER_AREA), 1);
}

}  // namespace
}  // namespace stillmap
