// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "track/keyframe_file.h"
#include "tracker_scene.h"

namespace stillmap {
namespace {

using synthetic::PathKind;
using test::Scene;

/// A tracker with its workers done at once. `see` may come from any log, as if the camera had been carried
/// there.
struct Robot {
  Nanoseconds frame_ns = 33'333'333;
  static Config config() {
    Config c = test::synthetic_config();
    c.track.lost_s = 0.5;
    return c;
  }
  Arena arena{std::size_t{160} << 20};
  Tracker tracker{arena, config()};
  std::uint64_t sequence = 0;

  TrackingResult see(Scene& scene) {
    FrameSlot slot = scene.slot(sequence);
    slot.colour_ns = slot.depth_ns =
        static_cast<Nanoseconds>(1'000'000'000) + static_cast<Nanoseconds>(sequence) * frame_ns;
    ++sequence;
    const TrackingResult result = tracker.track(slot, scene.mask());
    tracker.adjustment().work();
    tracker.loops().work();
    EXPECT_TRUE(test::all_finite(result)) << sequence;
    return result;
  }
  TrackingResult see(synthetic::SyntheticLog& log, int index) {
    Scene scene(log, index);
    return see(scene);
  }
  /// A lens with a hand before it: no corners.
  void see_nothing(synthetic::SyntheticLog& log, int frames) {
    for (int i = 0; i < frames; ++i) {
      Scene dark(log, 10);
      std::fill(dark.truth.colour.begin(), dark.truth.colour.end(), Bgr{7, 7, 7});
      EXPECT_EQ(see(dark).state, TrackState::Lost);
    }
  }
};

/// The camera's motion from `first` to `last`, as tracked in the map and in truth.
void expect_known(const test::Tracked& first, const test::Tracked& last) {
  const Pose estimate = inverse(first.result.T_map_camera()) * last.result.T_map_camera();
  const Pose truth = inverse(first.T_world_camera) * last.T_world_camera;
  EXPECT_LT(norm(estimate.t - truth.t), 0.05);
  EXPECT_LT(test::angle_between(estimate, truth), 0.03);
}

class TrackerSegments : public testing::Test {
 protected:
  synthetic::SyntheticLog here_{{.seed = 2, .people = 0, .path = PathKind::Walk}};
  synthetic::SyntheticLog there_{{.seed = 9, .people = 0, .path = PathKind::Rotate}};
  Robot robot_;
  test::Tracked see(synthetic::SyntheticLog& log, int index) {
    Scene scene(log, index);
    return {robot_.see(scene), scene.truth.T_world_camera};
  }
  /// Sees frames until there is a pose; how many that took.
  int until_pose(synthetic::SyntheticLog& log, int& index, int step = 1) {
    int frames = 0;
    for (; !see(log, index).result.has_pose() && frames < 60; index += step) ++frames;
    return frames;
  }
};

TEST_F(TrackerSegments, LostInNewTerritoryBeginsASegmentAndAnOlderOneIsFoundAgainAtOnce) {
  const test::Tracked first = see(here_, 0);
  for (int i = 1; i < 20; ++i) ASSERT_TRUE(see(here_, i).result.has_pose()) << i;
  EXPECT_EQ(first.result.segment, 1u);
  EXPECT_GT(first.result.covariance[0], 0) << "the map that hangs on it is not exact";

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
  for (int i = 20; i < 25; ++i) {
    const test::Tracked back = see(here_, i);
    ASSERT_TRUE(back.result.has_pose()) << i;
    EXPECT_EQ(back.result.segment, 2u) << "none begins";
    EXPECT_EQ(robot_.tracker.local_map().segment(), 1u);
    expect_known(first, back);
  }
}

/// A segment that runs into what an older one has mapped is joined to it; also where the map was saved and a
/// later run goes on in it.
TEST_F(TrackerSegments, AreJoinedWhenAKnownPlaceIsSeen) {
  constexpr int kStep = 8, kFar = 320;
  robot_.frame_ns *= kStep;
  const test::Tracked first = see(here_, 0);
  for (int i = kStep; i <= 10 * kStep; i += kStep) ASSERT_TRUE(see(here_, i).result.has_pose()) << i;
  int index = kFar;
  EXPECT_GE(until_pose(here_, index, 0), 2);
  for (index -= kStep; index > kFar / 2; index -= kStep) ASSERT_TRUE(see(here_, index).result.has_pose());
  ASSERT_EQ(robot_.tracker.local_map().segment(), 2u);

  std::vector<std::byte> saved, part(KeyframeWriter::kLargestRecord);
  for (KeyframeWriter writer; !writer.done(robot_.tracker.local_map());) {
    const std::size_t size = writer.write(robot_.tracker.local_map(), {}, part);
    saved.insert(saved.end(), part.begin(), part.begin() + static_cast<std::ptrdiff_t>(size));
  }
  Robot later;
  later.frame_ns = robot_.frame_ns;
  ASSERT_TRUE(later.tracker.resume(saved).ok());
  test::Tracked last, last_of_later;
  for (; index >= 0; index -= kStep) {
    Scene scene(here_, index);
    const Pose T_odom_before = last.result.T_odom_camera;
    const std::uint32_t epoch = last.result.correction_epoch;
    last = {robot_.see(scene), scene.truth.T_world_camera};
    ASSERT_TRUE(last.result.has_pose()) << index;
    if (last.result.correction_epoch != epoch) {
      const Pose step =
          inverse(here_.T_world_camera(here_.stamp_ns(index + kStep))) * scene.truth.T_world_camera;
      EXPECT_LT(norm((inverse(T_odom_before) * last.result.T_odom_camera).t - step.t), 0.05)
          << "odom does not jump";
    }
    last_of_later = {later.see(scene), scene.truth.T_world_camera};
    ASSERT_TRUE(last_of_later.result.has_pose()) << index;
  }
  EXPECT_GE(last.result.correction_epoch, 1u);
  expect_known(first, last);
  EXPECT_GE(last_of_later.result.correction_epoch, 1u);
  expect_known(first, last_of_later);
}

/// Only time with a view counts: as soon as there is one, the old place is looked for, and not given up at
/// once.
TEST_F(TrackerSegments, TimeInTheDarkIsNoReasonForANewOne) {
  for (int i = 0; i < 10; ++i) see(here_, i);
  int elsewhere = 0;
  EXPECT_FALSE(see(there_, elsewhere).result.has_pose());
  robot_.see_nothing(here_, 40);
  EXPECT_FALSE(see(there_, elsewhere).result.has_pose());
  const TrackingResult again = see(here_, 10).result;
  EXPECT_TRUE(again.has_pose());
  EXPECT_EQ(again.segment, 1u);
}

TEST_F(TrackerSegments, ACoveredLensBeginsNone) {
  for (int i = 0; i < 10; ++i) see(here_, i);
  robot_.see_nothing(here_, 40);
  const TrackingResult again = see(here_, 10).result;
  EXPECT_TRUE(again.has_pose());
  EXPECT_EQ(again.segment, 1u);
}

}  // namespace
}  // namespace stillmap
