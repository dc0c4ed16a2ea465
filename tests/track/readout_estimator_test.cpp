// SPDX-License-Identifier: Apache-2.0
#include "track/readout_estimator.h"

#include <gtest/gtest.h>

#include <vector>

#include "rolling_camera.h"
#include "scene.h"
#include "track/rolling_shutter.h"

namespace stillmap {
namespace {

constexpr int kPoints = 200;
constexpr Nanoseconds kFrame_ns = 33'000'000;

class ReadoutEstimatorTest : public testing::Test {
 protected:
  explicit ReadoutEstimatorTest(CameraModel model = test::kinect()) : camera(model) {
    for (int i = 0; i < kPoints; ++i) {
      const double z = 1 + 2 * random.uniform();
      world.push_back({(random.uniform() - 0.5) * z, (random.uniform() - 0.5) * 0.8 * z, z});
    }
  }
  /// A hand that shakes the camera for `frames` frames, whose rows take `readout_s`; a share of what it sees
  /// is matched to something else, and every corner is off by up to half a pixel.
  void shake(double readout_s, int frames, double wrong = 0, double strength = 1) {
    for (const int end = frame + frames; frame < end; ++frame) {
      const double t = frame * 0.033;
      const auto turned = [&](double at) {
        return exp_so3(0.1 * strength * Vec3{std::sin(5 * at), std::cos(4 * at), std::sin(3 * at)});
      };
      const Pose T_odom_camera{turned(t), {0.1 * std::sin(t), 0, 0}};
      const Vec3 turn = (1 / 0.002) * log_so3(transposed(turned(t - 0.001)) * turned(t + 0.001));
      std::vector<Feature> features;
      std::vector<FeatureMatch> inliers;
      for (int i = 0; i < kPoints; ++i) {
        const bool is_wrong = random.uniform() < wrong;
        const Vec3 p = world[is_wrong ? random.below(kPoints) : static_cast<std::size_t>(i)];
        Feature f = test::exposed(camera, readout_s * turn, inverse(T_odom_camera) * p);
        f.ray_x += static_cast<float>((random.uniform() - 0.5) / camera.fx);
        f.ray_y += static_cast<float>((random.uniform() - 0.5) / camera.fy);
        features.push_back(f);
        inliers.push_back({i, 0});
      }
      straighten_rows(camera, estimator.readout_s() * turn, features);
      estimator.observe(features, inliers, frame * kFrame_ns, T_odom_camera, turn);
    }
  }
  int frame = 0;
  Random random{5};
  CameraModel camera;
  std::vector<Vec3> world;
  Arena arena{test::kArenaBytes};
  ReadoutEstimator estimator{arena, camera, kPoints, kPoints};
};

struct LearningTest : ReadoutEstimatorTest, testing::WithParamInterface<double> {};

TEST_P(LearningTest, WhatTheRowsTakeIsLearnedInTwoSeconds) {
  shake(GetParam(), 60);
  EXPECT_NEAR(estimator.readout_s(), GetParam(), 0.001);
}
TEST_P(LearningTest, WrongMatchesMisleadItLittle) {
  shake(GetParam(), 60, 0.2);
  EXPECT_NEAR(estimator.readout_s(), GetParam(), 0.002);
}
INSTANTIATE_TEST_SUITE_P(GlobalRollingAndUpsideDown, LearningTest, testing::Values(0.0, 0.02, 0.03, -0.015));

TEST_F(ReadoutEstimatorTest, AStandingCameraSaysNothing) {
  const double before = estimator.readout_s();
  shake(0.03, 60, 0, 0);
  EXPECT_NEAR(estimator.readout_s(), before, 1e-4);
}

TEST_F(ReadoutEstimatorTest, FramesAreNotComparedOverALoss) {
  const double before = estimator.readout_s();
  for (int i = 0; i < 10; ++i) {
    shake(0.03, 4);  // too short a time to compare its frames
    estimator.clear();
  }
  EXPECT_EQ(estimator.readout_s(), before);
}

TEST_F(ReadoutEstimatorTest, AClockThatIsSetBackDoesNotEndTheLearning) {
  shake(0.02, 10);
  frame -= 100'000;  // nearly an hour
  shake(0.02, 60);
  EXPECT_NEAR(estimator.readout_s(), 0.02, 0.001);
}

struct MeasuredTest : ReadoutEstimatorTest {
  MeasuredTest() : ReadoutEstimatorTest(measured()) {}
  static CameraModel measured() {
    CameraModel camera = test::kinect();
    camera.readout_s = 0.025;
    return camera;
  }
};

TEST_F(MeasuredTest, WhatTheProfileSaysStays) {
  shake(0, 60);
  EXPECT_EQ(estimator.readout_s(), 0.025);
}

}  // namespace
}  // namespace stillmap
