// SPDX-License-Identifier: Apache-2.0
#include "core/tracking_result.h"

#include <gtest/gtest.h>

namespace stillmap {
namespace {

TEST(TrackingResult, OnlyTrackingAndWeakHaveAPose) {
  const auto has_pose = [](TrackState s) {
    TrackingResult r;
    r.state = s;
    return r.has_pose();
  };
  EXPECT_FALSE(has_pose(TrackState::Initializing));
  EXPECT_TRUE(has_pose(TrackState::Tracking));
  EXPECT_TRUE(has_pose(TrackState::Weak));
  EXPECT_FALSE(has_pose(TrackState::Lost));
}

TEST(TrackingResult, TheMapPoseIsTheCorrectionTimesTheOdometry) {
  TrackingResult r;
  r.T_map_odom = {exp_so3({0, 0, 1.5707963267948966}), {10, 0, 0}};
  r.T_odom_camera = {{}, {1, 0, 0}};
  const Vec3 t = r.T_map_camera().t;
  EXPECT_NEAR(t.x, 10, 1e-12);
  EXPECT_NEAR(t.y, 1, 1e-12);
}

TEST(TrackingResult, EveryStateHasAName) {
  EXPECT_STREQ(to_string(TrackState::Initializing), "initializing");
  EXPECT_STREQ(to_string(TrackState::Tracking), "tracking");
  EXPECT_STREQ(to_string(TrackState::Weak), "weak");
  EXPECT_STREQ(to_string(TrackState::Lost), "lost");
}

}  // namespace
}  // namespace stillmap
