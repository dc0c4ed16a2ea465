// SPDX-License-Identifier: Apache-2.0
#include "track/pose_covariance.h"

#include <gtest/gtest.h>

namespace stillmap {
namespace {

PoseEstimate solved(int observed = 100, int inliers = 100) {
  PoseEstimate e;
  e.observed = observed;
  e.inliers = inliers;
  for (std::size_t i = 0; i < 6; ++i) e.covariance[7 * i] = 1e-6;
  e.covariance[1] = e.covariance[6] = 4e-7;
  return e;
}

TEST(HonestCovariance, NeverSaysLessThanTheSolver) {
  const auto c = honest_covariance(solved(), {}, 0.02);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_GT(c[7 * i], 1e-6);
  EXPECT_GT(c[1], 4e-7);
  EXPECT_EQ(c[1], c[6]) << "symmetric";
}

TEST(HonestCovariance, GrowsWithSpeedTimesTheStampsError) {
  const auto still = honest_covariance(solved(), {}, 0.02),
             turning = honest_covariance(solved(), {1.5, 0}, 0.02),
             going = honest_covariance(solved(), {0, 2}, 0.02);
  EXPECT_NEAR(turning[0] - still[0], 0.03 * 0.03, 1e-12);
  EXPECT_GT(turning[21], still[21]) << "rows that turn look like a shift, too";
  EXPECT_NEAR(going[21] - still[21], 0.04 * 0.04, 1e-12);
  EXPECT_EQ(going[0], still[0]);
  EXPECT_EQ(honest_covariance(solved(), {1.5, 2}, 0)[0], still[0])
      << "a global shutter on the camera's clock";
}

TEST(HonestCovariance, DoubtsWhatTheMostSpeakAgainst) {
  const auto all = honest_covariance(solved(), {}, 0), half = honest_covariance(solved(100, 50), {}, 0),
             third = honest_covariance(solved(100, 33), {}, 0),
             tenth = honest_covariance(solved(100, 10), {}, 0);
  EXPECT_EQ(half, all);
  for (std::size_t i = 0; i < 36; i += 7) {
    EXPECT_GT(third[i], half[i]);
    EXPECT_GT(tenth[i], 4 * third[i]);
  }
  EXPECT_GT(tenth[0], 0.1 * 0.1) << "a mover may have been followed";
  EXPECT_EQ(honest_covariance(solved(0, 0), {}, 0), all) << "a first pose, by definition";
}

TEST(SpeedBetween, IsPerSecond) {
  const Pose a{exp_so3({0, 0.3, 0}), {1, 2, 3}};
  const Pose b = a * Pose{exp_so3({0, 0, 0.1}), {0, 0.03, 0.04}};
  const CameraSpeed speed = speed_between(a, b, 0.05);
  EXPECT_NEAR(speed.rad_per_s, 2, 1e-9);
  EXPECT_NEAR(speed.m_per_s, 1, 1e-9);
  EXPECT_EQ(speed_between(a, b, 0).rad_per_s, 0) << "a stamp that came twice";
}

}  // namespace
}  // namespace stillmap
