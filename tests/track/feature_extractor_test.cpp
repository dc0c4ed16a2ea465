// SPDX-License-Identifier: Apache-2.0
#include "track/feature_extractor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "scene.h"

namespace stillmap {
namespace {

using test::Image;

struct Extraction {
  Arena arena{test::kArenaBytes};
  FeatureExtractor extractor;
  FrameFeatures frame;
  explicit Extraction(const Config& config, std::size_t capacity = 1200)
      : extractor(arena, config.track, config.camera), frame(arena, capacity) {}
  void extract(const Image<std::uint8_t>& grey) { extractor.extract(grey.view(), frame); }
};

class FeatureExtractorTest : public testing::Test {
 protected:
  synthetic::SyntheticLog log_{{.seed = 3, .people = 0}};
  test::Scene scene_{log_, 0};
  Config config_ = test::synthetic_config();
};

TEST_F(FeatureExtractorTest, FindsWhatIsAskedForWithinThePicture) {
  Extraction e(config_);
  e.extract(scene_.grey);
  ASSERT_EQ(e.frame.features.size(), e.frame.descriptors.size());
  EXPECT_NEAR(static_cast<double>(e.frame.features.size()), config_.track.features, 5);
  for (const Feature& f : e.frame.features) {
    EXPECT_GE(f.x, 18);
    EXPECT_GE(f.y, 18);
    EXPECT_LE(f.x, 640 - 19);
    EXPECT_LE(f.y, 480 - 19);
    EXPECT_LT(f.octave, config_.track.levels);
    EXPECT_GE(f.response, config_.track.fast_threshold_min);
    EXPECT_LE(std::abs(f.angle_rad), std::numbers::pi + 1e-6);
    // No lens here: the ray is the pixel's.
    EXPECT_NEAR(f.ray_x, (f.x - 319.5) / 525, 1e-6);
    EXPECT_NEAR(f.ray_y, (f.y - 239.5) / 525, 1e-6);
  }
}

TEST_F(FeatureExtractorTest, RaysHonourTheLens) {
  config_.camera.k1 = 0.2624;
  config_.camera.k2 = -0.9531;
  config_.camera.p1 = -0.0054;
  config_.camera.p2 = 0.0026;
  config_.camera.k3 = 1.1633;
  Extraction e(config_);
  e.extract(scene_.grey);
  double furthest = 0;
  for (const Feature& f : e.frame.features) {
    const Vec2 pixel = config_.camera.project({f.ray_x, f.ray_y, 1});
    EXPECT_NEAR(pixel.x, f.x, 1e-3);
    EXPECT_NEAR(pixel.y, f.y, 1e-3);
    furthest = std::max(furthest, std::abs(f.ray_x - (f.x - 319.5) / 525));
  }
  EXPECT_GT(furthest, 0.005) << "the lens changes nothing here";
}

TEST_F(FeatureExtractorTest, SpreadsEvenly) {
  Extraction e(config_);
  e.extract(scene_.grey);
  std::array<int, 12> per_tile{};  // 4 x 3 tiles
  for (const Feature& f : e.frame.features) {
    ++per_tile[static_cast<std::size_t>(static_cast<int>(f.y) / 160 * 4 + static_cast<int>(f.x) / 160)];
  }
  for (const int count : per_tile) {
    EXPECT_GT(count, 25);
    EXPECT_LT(count, 200);
  }
}

/// A picture that is busy on one side and calm on the other: the calm side has its share all the same.
TEST_F(FeatureExtractorTest, ABusyCornerDoesNotTakeAll) {
  Image<std::uint8_t> picture(640, 480, 100);
  Random random(2);
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 200; ++x) picture.view().at(x, y) = static_cast<std::uint8_t>(random.below(256));
  }
  for (int y = 40; y < 460; y += 40) {
    for (int x = 240; x < 620; x += 40) {
      for (int i = 0; i < 64; ++i)
        picture.view().at(x + i % 8, y + i / 8) = 112;  // weak: below fast_threshold
    }
  }
  Extraction e(config_);
  e.extract(picture);
  int calm = 0;
  for (const Feature& f : e.frame.features) calm += f.x > 220;
  EXPECT_GT(calm, 90);
}

TEST_F(FeatureExtractorTest, ABlankPictureHasNone) {
  for (const int value : {0, 255}) {
    Extraction e(config_);
    e.extract(scene_.grey);  // leftovers must not come back
    e.extract(Image<std::uint8_t>(640, 480, static_cast<std::uint8_t>(value)));
    EXPECT_TRUE(e.frame.features.empty());
    EXPECT_TRUE(e.frame.descriptors.empty());
  }
}

TEST_F(FeatureExtractorTest, NeverExceedsTheCapacity) {
  config_.track.features = 1200;
  Extraction e(config_, 700);
  e.extract(scene_.grey);
  EXPECT_EQ(e.frame.features.size(), 700u);
  EXPECT_EQ(e.frame.descriptors.size(), 700u);
}

TEST_F(FeatureExtractorTest, TheSamePictureGivesTheSameBytes) {
  Extraction a(config_), b(config_);
  b.extract(test::Scene(log_, 7).grey);  // b has a past
  a.extract(scene_.grey);
  b.extract(scene_.grey);
  ASSERT_EQ(a.frame.features.size(), b.frame.features.size());
  for (std::size_t i = 0; i < a.frame.features.size(); ++i) {
    EXPECT_EQ(a.frame.features[i].x, b.frame.features[i].x);
    EXPECT_EQ(a.frame.features[i].y, b.frame.features[i].y);
    EXPECT_EQ(a.frame.features[i].angle_rad, b.frame.features[i].angle_rad);
    EXPECT_EQ(hamming(a.frame.descriptors[i], b.frame.descriptors[i]), 0);
  }
}

TEST_F(FeatureExtractorTest, SmallPicturesAndSteepPyramidsWork) {
  config_.camera = {.width = 160, .height = 120, .fx = 130, .fy = 130, .cx = 80, .cy = 60};
  config_.track.scale_factor = 1.9;
  Image<std::uint8_t> small(160, 120);
  for (int y = 0; y < 120; ++y) std::copy_n(scene_.grey.view().row(200 + y) + 200, 160, small.view().row(y));
  Extraction e(config_);
  e.extract(small);
  EXPECT_GT(e.frame.features.size(), 20u);
}

/// Turns the picture about its centre and looks for each feature where it must be then.
TEST_F(FeatureExtractorTest, DescriptorsSurviveATurn) {
  Extraction before(config_);
  before.extract(scene_.grey);
  for (const double degrees : {30.0, 90.0, 137.0, 180.0}) {
    const cv::Mat turn = cv::getRotationMatrix2D({319.5f, 239.5f}, degrees, 1);
    Image<std::uint8_t> turned(640, 480);
    const cv::Mat from(480, 640, CV_8U, scene_.grey.pixels.data());
    cv::Mat to(480, 640, CV_8U, turned.pixels.data());
    cv::warpAffine(from, to, turn, to.size(), cv::INTER_LINEAR);
    Extraction after(config_);
    after.extract(turned);

    int found = 0, near = 0;
    double same = 0, other = 0, angle_error = 0;
    for (std::size_t i = 0; i < before.frame.features.size(); ++i) {
      const Feature& f = before.frame.features[i];
      const double x = turn.at<double>(0, 0) * f.x + turn.at<double>(0, 1) * f.y + turn.at<double>(0, 2);
      const double y = turn.at<double>(1, 0) * f.x + turn.at<double>(1, 1) * f.y + turn.at<double>(1, 2);
      for (std::size_t k = 0; k < after.frame.features.size(); ++k) {
        const Feature& g = after.frame.features[k];
        if (g.octave != f.octave || std::hypot(g.x - x, g.y - y) > 1.0) continue;
        ++found;
        const int distance = hamming(before.frame.descriptors[i], after.frame.descriptors[k]);
        same += distance;
        near += distance <= 64;
        other += hamming(before.frame.descriptors[i],
                         after.frame.descriptors[(k + 97) % after.frame.descriptors.size()]);
        const double turned_by = g.angle_rad - f.angle_rad + degrees * std::numbers::pi / 180;
        angle_error += std::abs(std::remainder(turned_by, 2 * std::numbers::pi));
        break;
      }
    }
    ASSERT_GT(found, 100) << degrees;
    EXPECT_LT(same / found, 40) << degrees;
    EXPECT_GT(near, 0.85 * found) << degrees;
    EXPECT_GT(other / found, 85) << degrees;
    EXPECT_LT(angle_error / found, 0.15) << degrees;
  }
}

TEST_F(FeatureExtractorTest, CornersOfADrawnSquareAreFoundToThePixel) {
  Image<std::uint8_t> picture(640, 480, 60);
  for (int y = 200; y <= 280; ++y) std::fill_n(picture.view().row(y) + 300, 81, std::uint8_t{180});
  config_.track.levels = 1;
  Extraction e(config_);
  e.extract(picture);
  for (const auto& [x, y] : {std::pair{300.0f, 200.0f}, {380, 200}, {300, 280}, {380, 280}}) {
    double nearest = 1e9;
    for (const Feature& f : e.frame.features)
      nearest = std::min<double>(nearest, std::hypot(f.x - x, f.y - y));
    EXPECT_LE(nearest, 2) << x << ", " << y;
  }
}

/// Coarse levels must put a corner where it is at full resolution: the mapping of pixel centres has no bias.
TEST_F(FeatureExtractorTest, LevelsAgreeOnWhereACornerIs) {
  Image<std::uint8_t> picture(640, 480, 60);
  // Bright squares; the centre of their four corners is their own centre on every level.
  for (int y = 200; y <= 280; ++y) std::fill_n(picture.view().row(y) + 300, 81, std::uint8_t{180});
  Extraction e(config_);
  e.extract(picture);
  std::array<Vec2, 8> sum{};
  std::array<int, 8> count{};
  for (const auto& [x, y] : {std::pair{300.0f, 200.0f}, {380, 200}, {300, 280}, {380, 280}}) {
    for (int level = 0; level < 8; ++level) {
      const auto l = static_cast<std::size_t>(level);
      double nearest = 1e9;
      Vec2 at;
      for (const Feature& f : e.frame.features) {
        const double distance = std::hypot(f.x - x, f.y - y);
        if (f.octave == level && distance < nearest) {
          nearest = distance;
          at = {f.x, f.y};
        }
      }
      if (nearest > 10) continue;
      ++count[l];
      sum[l] = {sum[l].x + at.x, sum[l].y + at.y};
    }
  }
  int levels = 0;
  for (std::size_t l = 0; l < 8; ++l) {
    if (count[l] != 4) continue;
    ++levels;
    EXPECT_NEAR(sum[l].x / 4, 340, 0.8 * e.extractor.scale(static_cast<int>(l))) << "level " << l;
    EXPECT_NEAR(sum[l].y / 4, 240, 0.8 * e.extractor.scale(static_cast<int>(l))) << "level " << l;
  }
  EXPECT_GE(levels, 4);
}

}  // namespace
}  // namespace stillmap
