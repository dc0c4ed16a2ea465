// SPDX-License-Identifier: Apache-2.0
#include "track/pyramid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "scene.h"

namespace stillmap {
namespace {

using test::Image;

cv::Mat header_over(ImageView<const std::uint8_t> view) {
  return {view.height, view.width, CV_8U, const_cast<std::uint8_t*>(view.data),
          static_cast<std::size_t>(view.stride)};
}

struct Difference {
  int largest = 0;
  double mean = 0;  // signed
};

Difference difference(ImageView<const std::uint8_t> ours, const cv::Mat& reference, int border) {
  Difference d;
  int count = 0;
  for (int y = border; y < ours.height - border; ++y) {
    for (int x = border; x < ours.width - border; ++x, ++count) {
      const int delta = ours.at(x, y) - reference.at<std::uint8_t>(y, x);
      d.largest = std::max(d.largest, std::abs(delta));
      d.mean += delta;
    }
  }
  d.mean /= count;
  return d;
}

TEST(Pyramid, SizesAndScalesFollowTheFactor) {
  Arena arena(test::kArenaBytes);
  Pyramid pyramid(arena, 640, 480, 8, 1.2);
  Image<std::uint8_t> grey(640, 480, 7);
  pyramid.build(grey.view());
  ASSERT_EQ(pyramid.levels(), 8);
  for (int level = 0; level < 8; ++level) {
    const double scale = std::pow(1.2, level);
    EXPECT_NEAR(pyramid.scale(level), scale, 1e-12);
    EXPECT_EQ(pyramid.image(level).width, std::lround(640 / scale));
    EXPECT_EQ(pyramid.image(level).height, std::lround(480 / scale));
    EXPECT_EQ(pyramid.smooth(level).width, pyramid.image(level).width);
    EXPECT_EQ(pyramid.smooth(level).height, pyramid.image(level).height);
  }
  EXPECT_EQ(pyramid.image(0).data, grey.view().data) << "level 0 is the picture itself, not a copy";
}

TEST(Pyramid, AFlatPictureStaysFlat) {
  for (const int value : {0, 1, 128, 254, 255}) {
    Arena arena(test::kArenaBytes);
    Pyramid pyramid(arena, 640, 480, 8, 1.2);
    const Image<std::uint8_t> grey(640, 480, static_cast<std::uint8_t>(value));
    pyramid.build(grey.view());
    for (int level = 0; level < 8; ++level) {
      const auto image = pyramid.image(level), smooth = pyramid.smooth(level);
      for (int y = 0; y < image.height; ++y) {
        for (int x = 0; x < image.width; ++x) {
          ASSERT_EQ(image.at(x, y), value) << "level " << level;
          if (x < 3 || y < 3 || x >= image.width - 3 || y >= image.height - 3) continue;
          ASSERT_EQ(smooth.at(x, y), value) << "level " << level;
        }
      }
    }
  }
}

TEST(Pyramid, AgreesWithOpenCvOnARenderedPicture) {
  synthetic::SyntheticLog log({.seed = 3});
  const test::Scene scene(log, 0);
  Arena arena(test::kArenaBytes);
  Pyramid pyramid(arena, 640, 480, 8, 1.2);
  pyramid.build(scene.grey.view());
  for (int level = 0; level < 8; ++level) {
    const auto image = pyramid.image(level);
    cv::Mat reference;
    if (level > 0) {
      // In floating point: OpenCV's 8-bit way cuts off instead of rounding.
      cv::Mat exact;
      header_over(pyramid.image(level - 1)).convertTo(exact, CV_32F);
      cv::resize(exact, exact, {image.width, image.height}, 0, 0, cv::INTER_LINEAR);
      exact.convertTo(reference, CV_8U);
      const Difference resized = difference(image, reference, 0);
      EXPECT_LE(resized.largest, 2) << "level " << level;
      EXPECT_LT(std::abs(resized.mean), 0.1) << "level " << level;  // halves go up, twice
    }
    cv::GaussianBlur(header_over(image), reference, {7, 7}, 2, 2);
    const Difference blurred = difference(pyramid.smooth(level), reference, 3);
    EXPECT_LE(blurred.largest, 2) << "level " << level;
    EXPECT_LT(std::abs(blurred.mean), 0.3) << "level " << level;
  }
}

TEST(Pyramid, ReadsAPictureWithAStride) {
  synthetic::SyntheticLog log({.seed = 3});
  const test::Scene scene(log, 0);
  const ImageView<const std::uint8_t> window{scene.grey.view().row(40) + 50, 320, 240, 640};
  Image<std::uint8_t> copy(320, 240);
  for (int y = 0; y < 240; ++y) std::copy_n(window.row(y), 320, copy.view().row(y));
  Arena arena(test::kArenaBytes);
  Pyramid from_window(arena, 320, 240, 4, 1.3), from_copy(arena, 320, 240, 4, 1.3);
  from_window.build(window);
  from_copy.build(copy.view());
  for (int y = 3; y < from_copy.image(3).height - 3; ++y) {
    for (int x = 3; x < from_copy.image(3).width - 3; ++x) {
      ASSERT_EQ(from_window.image(3).at(x, y), from_copy.image(3).at(x, y));
      ASSERT_EQ(from_window.smooth(3).at(x, y), from_copy.smooth(3).at(x, y));
    }
  }
}

/// The smallest picture and steepest factor that the configuration lets through: the last level is one pixel.
TEST(Pyramid, SurvivesTheSmallestAllowedPicture) {
  Arena arena(test::kArenaBytes);
  Pyramid pyramid(arena, 160, 120, 8, 2.0);
  const Image<std::uint8_t> grey(160, 120, 90);
  pyramid.build(grey.view());
  EXPECT_EQ(pyramid.image(7).width, 1);
  EXPECT_EQ(pyramid.image(7).height, 1);
  EXPECT_EQ(pyramid.image(7).at(0, 0), 90);
}

TEST(Pyramid, PlansWhatItTakes) {
  Arena plan;
  const Pyramid planned(plan, 640, 480, 8, 1.2);
  EXPECT_GT(plan.bytes_planned(), 640u * 480u);
  Arena arena(plan.bytes_planned());
  Pyramid pyramid(arena, 640, 480, 8, 1.2);
  EXPECT_EQ(arena.bytes_planned(), plan.bytes_planned());
}

}  // namespace
}  // namespace stillmap
