// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "tracker_scene.h"

namespace stillmap {
namespace {

using synthetic::PathKind;
using test::Scene;

/// A camera that is carried from one room to another and back, without a view of the way between.
class TrackerSegments : public testing::Test {
 protected:
  static constexpr Nanoseconds kFrame_ns = 33'333'333;
  static Config config() {
    Config c = test::synthetic_config();
    c.track.lost_s = 0.5;
    return c;
  }
  synthetic::SyntheticLog here_{{.seed = 2, .people = 0, .path = PathKind::Rotate}};
  synthetic::SyntheticLog there_{{.seed = 9, .people = 0, .path = PathKind::Rotate}};
  Arena arena_{std::size_t{160} << 20};
  Tracker tracker_{arena_, config()};
  std::uint64_t sequence_ = 0;

  test::Tracked see(synthetic::SyntheticLog& log, int index) {
    Scene scene(log, index);
    FrameSlot slot = scene.slot(sequence_);
    slot.colour_ns = slot.depth_ns = static_cast<Nanoseconds>(1'000'000'000 + sequence_ * kFrame_ns);
    ++sequence_;
    const test::Tracked tracked{tracker_.track(slot, scene.mask()), scene.truth.T_world_camera};
    tracker_.adjustment().work();
    tracker_.loops().work();
    EXPECT_TRUE(test::all_finite(tracked.result)) << sequence_;
    return tracked;
  }
  /// Sees frames until there is a pose; how many that took.
  int until_pose(synthetic::SyntheticLog& log, int& index) {
    int frames = 0;
    while (!see(log, index++).result.has_pose() && frames < 60) ++frames;
    return frames;
  }
};

TEST_F(TrackerSegments, LostInNewTerritoryBeginsASegmentWhichIsJoinedWhenAKnownPlaceIsSeen) {
  const test::Tracked first = see(here_, 0);
  for (int i = 1; i < 50; ++i) ASSERT_TRUE(see(here_, i).result.has_pose()) << i;
  EXPECT_EQ(first.result.segment, 1u);

  int index = 0;
  const int lost = until_pose(there_, index);
  EXPECT_GE(lost, 15) << "half a second is waited for";
  EXPECT_LE(lost, 17);
  for (const int end = index + 8; index < end; ++index) {
    const TrackingResult result = see(there_, index).result;
    ASSERT_TRUE(result.has_pose()) << index;
    EXPECT_EQ(result.segment, 2u);
    EXPECT_EQ(result.correction_epoch, 0u) << "nothing of it is known";
  }

  // Back again. What is seen belongs to the first segment, and once that is sure, the map says so.
  index = 0;
  until_pose(here_, index);
  test::Tracked last;
  Pose T_odom_before;
  for (; index < 110 && last.result.correction_epoch == 0; ++index) {
    T_odom_before = last.result.T_odom_camera;
    const std::uint32_t epoch = last.result.correction_epoch;
    last = see(here_, index);
    ASSERT_TRUE(last.result.has_pose()) << index;
    if (last.result.correction_epoch != epoch) {
      EXPECT_LT(norm(last.result.T_odom_camera.t - T_odom_before.t), 0.05) << "odom never jumps";
    }
  }
  EXPECT_EQ(last.result.segment, 3u);
  ASSERT_GE(last.result.correction_epoch, 1u);
  const Pose estimate = inverse(first.result.T_map_camera()) * last.result.T_map_camera();
  const Pose truth = inverse(first.T_world_camera) * last.T_world_camera;
  EXPECT_LT(norm(estimate.t - truth.t), 0.05);
  EXPECT_LT(test::angle_between(estimate, truth), 0.03);
}

TEST_F(TrackerSegments, ACoveredLensBeginsNone) {
  for (int i = 0; i < 10; ++i) see(here_, i);
  for (int i = 0; i < 40; ++i) {
    Scene dark(here_, 10);
    std::fill(dark.truth.colour.begin(), dark.truth.colour.end(), Bgr{7, 7, 7});
    FrameSlot slot = dark.slot(sequence_);
    slot.colour_ns = slot.depth_ns = static_cast<Nanoseconds>(1'000'000'000 + sequence_ * kFrame_ns);
    ++sequence_;
    EXPECT_EQ(tracker_.track(slot, {}).state, TrackState::Lost);
  }
  const TrackingResult again = see(here_, 10).result;
  EXPECT_TRUE(again.has_pose());
  EXPECT_EQ(again.segment, 1u);
}

}  // namespace
}  // namespace stillmap
