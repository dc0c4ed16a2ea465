// SPDX-License-Identifier: Apache-2.0
#include "runtime/final_trajectory.h"

#include <gtest/gtest.h>

#include <memory>

namespace stillmap {
namespace {

Pose at(double x) {
  return {{}, {x, 0, 0}};
}

/// Keyframe k at x = k, with one frame half a metre on.
class FinalTrajectoryTest : public testing::Test {
 protected:
  Arena arena_{1 << 20};
  FinalTrajectory trajectory_{arena_, 100};
  std::unique_ptr<Correction> correction_ = std::make_unique<Correction>();

  void SetUp() override {
    for (std::uint32_t k = 1; k <= 5; ++k) {
      for (const double ahead : {0.0, 0.5}) {
        TrackingResult result;
        result.stamp_ns = static_cast<Nanoseconds>(1000 * (k + ahead));
        result.state = TrackState::Tracking;
        result.reference_keyframe = k;
        result.T_odom_camera = at(k + ahead);
        trajectory_.note(result, at(k));
      }
    }
  }
  void move(std::uint32_t id, double to_x) {
    ASSERT_TRUE(correction_->keyframes.try_push_back({id, at(to_x)}));
  }
  std::vector<double> xs() const {
    std::vector<double> all;
    for (const StampedPose& p : trajectory_.poses()) all.push_back(p.T_world_camera.t.x);
    return all;
  }
};

TEST_F(FinalTrajectoryTest, IsTheCausalOneWhereNothingWasCorrected) {
  EXPECT_EQ(xs(), (std::vector<double>{1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5, 5.5}));
  EXPECT_EQ(trajectory_.poses()[1].stamp_ns, 1500);
}

TEST_F(FinalTrajectoryTest, FramesMoveWithTheirKeyframe) {
  move(3, 13);
  for (const std::uint32_t k : {1u, 2u, 4u, 5u}) move(k, k);
  trajectory_.correct(*correction_);
  EXPECT_EQ(xs(), (std::vector<double>{1, 1.5, 2, 2.5, 13, 13.5, 4, 4.5, 5, 5.5}));
}

TEST_F(FinalTrajectoryTest, KeyframesThatAreGoneMoveWithTheirNeighbours) {
  move(2, 12);  // 1 goes with 2, which comes after; 3 goes with 2, which comes before
  move(4, 24);
  trajectory_.correct(*correction_);
  EXPECT_EQ(xs(), (std::vector<double>{11, 11.5, 12, 12.5, 13, 13.5, 24, 24.5, 25, 25.5}));
}

TEST_F(FinalTrajectoryTest, ASegmentMovesWithoutTheOneBefore) {
  correction_->segment_begin = 3;
  move(2, 2);
  move(5, 105);
  trajectory_.correct(*correction_);
  EXPECT_EQ(xs(), (std::vector<double>{1, 1.5, 2, 2.5, 103, 103.5, 104, 104.5, 105, 105.5}));
  correction_->keyframes.clear();  // the first segment is gone: it moves with what there is
  move(5, 205);
  trajectory_.correct(*correction_);
  EXPECT_EQ(xs(), (std::vector<double>{101, 101.5, 102, 102.5, 203, 203.5, 204, 204.5, 205, 205.5}));
}

TEST_F(FinalTrajectoryTest, CorrectionsAddUp) {
  move(5, 6);
  trajectory_.correct(*correction_);
  trajectory_.correct(*correction_);  // absolute: the same again changes nothing
  EXPECT_EQ(xs().back(), 6.5);
  EXPECT_EQ(xs().front(), 2);
}

TEST(FinalTrajectory, WithoutRoomNothingIsKept) {
  Arena arena(1 << 16);
  FinalTrajectory none(arena, 0);
  none.note({}, {});
  EXPECT_TRUE(none.poses().empty());
}

}  // namespace
}  // namespace stillmap
