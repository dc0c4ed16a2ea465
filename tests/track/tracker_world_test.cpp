// SPDX-License-Identifier: Apache-2.0
// What the world does to a tracker: darkness, no depth, a covered lens, wild stamps, frames full of movers.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "tests/support/shared_folder.h"
#include "tracker_scene.h"

namespace stillmap {
namespace {

using test::Scene;
using test::Tracked;
using test::TrackerScene;

void darken(Scene& scene) {
  std::fill(scene.truth.colour.begin(), scene.truth.colour.end(), Bgr{});
}
void take_depth(Scene& scene) {
  std::fill(scene.truth.depth.begin(), scene.truth.depth.end(), std::uint16_t{0});
}
void all_dynamic(DynamicMask& mask) {
  mask.cells.fill({1, 60000, Label::Dynamic, 0});
}

TEST(TrackerWorld, StartsOnlyOnAUsableFrame) {
  TrackerScene scene({.seed = 2, .people = 0});
  const auto unusable = [](int index, Scene& s, DynamicMask& mask) {
    if (index == 0) darken(s);
    if (index == 1) take_depth(s);
    if (index == 2) all_dynamic(mask);
  };
  for (int i = 0; i < 3; ++i) {
    const TrackingResult result = scene.step(i, unusable).result;
    EXPECT_EQ(result.state, TrackState::Initializing) << i;
    EXPECT_FALSE(result.has_pose());
    EXPECT_FALSE(result.is_keyframe);
    EXPECT_EQ(result.inliers, 0);
  }
  const std::vector<Tracked> run = scene.run(3, 10);
  EXPECT_TRUE(run.front().result.is_keyframe);
  for (const Tracked& t : run) EXPECT_EQ(t.result.state, TrackState::Tracking);
  EXPECT_LT(norm(run.front().result.T_odom_camera.t), 1e-12) << "odom begins where tracking begins";
  EXPECT_LT(test::drift_rmse_m(run), 0.005);
}

TEST(TrackerWorld, BlackFromTheFirstFrameNeverStarts) {
  TrackerScene scene({.seed = 2, .people = 0});
  for (const Tracked& t : scene.run(0, 5, [](int, Scene&s, DynamicMask&) { darken(s); })) {
    EXPECT_EQ(t.result.state, TrackState::Initializing);
    EXPECT_EQ(t.result.features, 0);
  }
}

/// A hand before the lens for a second and more, while the camera goes on moving.
TEST(TrackerWorld, ACoveredLensIsLostAndThenFoundAgain) {
  TrackerScene scene({.seed = 2, .people = 0});
  const std::vector<Tracked> before = scene.run(0, 30);
  for (int i = 30; i < 70; i += 4) {
    const TrackingResult result = scene.step(i, [](int, Scene& s, DynamicMask&) { darken(s); }).result;
    EXPECT_EQ(result.state, TrackState::Lost) << i;
    EXPECT_FALSE(result.has_pose()) << "a predicted pose is never published";
    EXPECT_EQ(result.inliers, 0);
    EXPECT_EQ(result.matches, 0);
    EXPECT_FALSE(result.is_keyframe);
  }
  std::vector<Tracked> all = before;
  int frames = 0;
  for (int i = 70; i < 80; ++i) {
    const Tracked t = scene.step(i);
    if (!t.result.has_pose()) ++frames;
    all.push_back(t);
  }
  EXPECT_LE(frames, 2) << "frames until it was found again";
  EXPECT_TRUE(all.back().result.has_pose());
  EXPECT_LT(test::drift_rmse_m(all), 0.01) << "in the same odom frame as before";
}

/// Blurred until no corner looks as before, as by a jerk: the picture as a whole tells of the motion, for a
/// fifth of a second.
TEST(TrackerWorld, AMomentWithoutPointsIsBridgedByThePictureAsAWhole) {
  TrackerScene scene({.seed = 2, .people = 0});
  const std::vector<Tracked> before = scene.run(0, 30);
  const auto points = scene.tracker.point_usage().high_water;
  const auto keyframes = scene.tracker.keyframe_usage().high_water;
  std::vector<Tracked> all = before;
  int bridged = 0;
  for (int i = 30; i < 45; ++i) {
    const Tracked t = scene.step(i, [](int, Scene& s, DynamicMask&) { blur(s); });
    EXPECT_EQ(t.result.inliers, 0);
    EXPECT_FALSE(t.result.stands_on_points());
    EXPECT_FALSE(t.result.is_keyframe);
    if (!t.result.has_pose()) continue;
    EXPECT_EQ(t.result.state, TrackState::Weak);
    EXPECT_EQ(bridged, i - 30) << "once lost it is not taken up again";
    EXPECT_GT(t.result.covariance[0], all.back().result.covariance[0]) << "each step adds its error";
    ++bridged;
    all.push_back(t);
  }
  EXPECT_EQ(bridged, 6) << "at 30 Hz";
  EXPECT_EQ(scene.tracker.point_usage().high_water, points);
  EXPECT_EQ(scene.tracker.keyframe_usage().high_water, keyframes);
  EXPECT_LT(test::drift_rmse_m(all), 0.01);
  for (const Tracked& t : scene.run(45, 50)) all.push_back(t);
  EXPECT_TRUE(all.back().result.stands_on_points());
  EXPECT_LT(test::drift_rmse_m(all), 0.01);
}

/// It comes back where it has been, far from the newest keyframe: the others are tried in turn.
TEST(TrackerWorld, FindsAnOlderPlaceAgain) {
  TrackerScene scene({.seed = 2, .people = 0, .path = synthetic::PathKind::Rotate});
  std::vector<Tracked> all = scene.run(0, 60);
  ASSERT_GE(scene.tracker.keyframe_usage().high_water, 4u);
  const double apart = test::angle_between(all.front().T_world_camera, all.back().T_world_camera);
  ASSERT_GT(apart, 0.3);
  // The lens is covered, and when it is free again the camera looks where it looked first.
  for (int i = 60; i < 63; ++i) scene.step(i, [](int, Scene& s, DynamicMask&) { darken(s); });
  int found_after = -1;
  for (int i = 0; i < 20 && found_after < 0; ++i) {
    Scene again(scene.log, 2);
    FrameSlot slot = again.slot(static_cast<std::uint64_t>(100 + i));
    slot.colour_ns = slot.depth_ns = scene.log.stamp_ns(100 + i);
    const Tracked t{scene.tracker.track(slot, again.mask()), again.truth.T_world_camera};
    if (!t.result.has_pose()) continue;
    found_after = i;
    all.push_back(t);
    const Pose estimate = inverse(all.front().result.T_odom_camera) * t.result.T_odom_camera;
    const Pose truth = inverse(all.front().T_world_camera) * t.T_world_camera;
    EXPECT_LT(norm(estimate.t - truth.t), 0.03);
    EXPECT_LT(test::angle_between(estimate, truth), 0.02);
  }
  EXPECT_GE(found_after, 0);
}

TEST(TrackerWorld, TracksOnWithoutDepthForAWhile) {
  TrackerScene scene({.seed = 2, .people = 0});
  std::vector<Tracked> all = scene.run(0, 15);
  for (const Tracked& t : scene.run(15, 22, [](int, Scene&s, DynamicMask&) { take_depth(s); })) {
    EXPECT_TRUE(t.result.has_pose()) << t.result.sequence;
    all.push_back(t);
  }
  for (const Tracked& t : scene.run(22, 26)) all.push_back(t);
  EXPECT_LT(test::drift_rmse_m(all), 0.01);
}

/// The whole view is called a mover's (a detector gone wild): never a confident wrong pose.
TEST(TrackerWorld, AFrameFullOfMoversIsNotTrackedWrongly) {
  for (const DynamicRule rule : {DynamicRule::Paper, DynamicRule::Silhouette}) {
    Config config = test::synthetic_config();
    config.track.dynamic_rule = rule;
    TrackerScene scene({.seed = 2, .people = 0}, config);
    std::vector<Tracked> all = scene.run(0, 12, [&](int, Scene&, DynamicMask& mask) { mask.rule = rule; });
    for (int i = 12; i < 18; ++i) {
      const Tracked t = scene.step(i, [&](int, Scene&, DynamicMask& mask) {
        mask.rule = rule;
        all_dynamic(mask);
        static_cast<void>(
            mask.boxes.items.try_push_back({.box = {0, 0, 640, 480}, .kind = ClassKind::Dynamic}));
      });
      EXPECT_TRUE(rule != DynamicRule::Paper || t.result.state == TrackState::Lost)
          << "no feature may be used";
      all.push_back(t);
    }
    EXPECT_LT(test::drift_rmse_m(all), 0.01);
    const Tracked after = scene.step(18, [&](int, Scene&, DynamicMask& mask) { mask.rule = rule; });
    EXPECT_TRUE(after.result.has_pose());
  }
}

/// Walkers cover most of the view and there is no mask at all: worse, but finite and never silent nonsense.
TEST(TrackerWorld, AMissedDetectionDoesNotBreakIt) {
  TrackerScene scene({.seed = 2, .people = 3});
  std::vector<Tracked> all = scene.run(0, 40, [](int index, Scene&, DynamicMask& mask) {
    if (index % 5 == 4) mask.cells.fill({});
  });
  for (const Tracked& t : all) EXPECT_TRUE(t.result.has_pose()) << t.result.sequence;
  EXPECT_LT(test::drift_rmse_m(all), 0.01);
}

/// Stamps that repeat, stand still or go back (a log played backwards) must not make poses infinite.
TEST(TrackerWorld, WildStampsGiveNoWildPoses) {
  TrackerScene scene({.seed = 2, .people = 0});
  static_cast<void>(scene.run(0, 5));
  const Nanoseconds at = scene.log.stamp_ns(5);
  std::uint64_t sequence = 100;
  for (const Nanoseconds stamp :
       {at, at, at, at - 1'000'000'000, at - 1'000'000'000, at + 60'000'000'000, at}) {
    Scene frame(scene.log, 5);
    FrameSlot slot = frame.slot(sequence++);
    slot.colour_ns = stamp;
    slot.depth_ns = stamp + 5'000'000;
    const TrackingResult result = scene.tracker.track(slot, frame.mask());
    EXPECT_TRUE(test::all_finite(result)) << sequence;
    EXPECT_TRUE(result.has_pose()) << sequence;
    for (const Nanoseconds ahead : {Nanoseconds{0}, Nanoseconds{33'000'000}, Nanoseconds{-33'000'000},
                                    Nanoseconds{3'600'000'000'000}}) {
      EXPECT_TRUE(is_finite(scene.tracker.predict(stamp + ahead)));
    }
  }
}

TEST(TrackerWorld, PredictionGoesOnAtTheSameSpeed) {
  TrackerScene scene({.seed = 2, .people = 0, .noise = false});
  EXPECT_LT(norm(scene.tracker.predict(scene.log.stamp_ns(0)).t), 1e-12);
  std::vector<Tracked> run = scene.run(0, 12);
  const Pose predicted = scene.tracker.predict(scene.log.stamp_ns(12));
  const Tracked next = scene.step(12);
  const Pose moved = inverse(run.back().result.T_odom_camera) * next.result.T_odom_camera;
  ASSERT_GT(norm(moved.t), 0.004) << "the camera stands still";
  EXPECT_LT(norm(predicted.t - next.result.T_odom_camera.t), 0.5 * norm(moved.t));
}

/// A man at a desk and a camera turned by hand, with blur: recorded, not rendered.
TEST(TrackerWorld, FollowsARecordedLog) {
  STILLMAP_NEEDS_SHARED();
  const auto files = test::list_rgbd(test::shared_folder() / "data/fr1_rpy");
  ASSERT_GE(files.size(), 60u);
  Config config;
  config.camera = {.width = 640,
                   .height = 480,
                   .fx = 517.3,
                   .fy = 516.5,
                   .cx = 318.6,
                   .cy = 255.3,
                   .k1 = 0.2624,
                   .k2 = -0.9531,
                   .p1 = -0.0054,
                   .p2 = 0.0026,
                   .k3 = 1.1633,
                   .depth_units_per_m = 5000};
  Arena arena(std::size_t{160} << 20);
  Tracker tracker(arena, config);
  double most_moved = 0;
  for (std::size_t i = 0; i < 60; ++i) {
    test::Image<Bgr> colour = test::read_colour(files[i].colour);
    test::Image<std::uint16_t> depth = test::read_depth(files[i].depth);
    FrameSlot slot;
    slot.sequence = i;
    slot.colour_ns = slot.depth_ns = static_cast<Nanoseconds>(i) * 33'333'333;
    slot.colour = colour.view();
    slot.depth = depth.view();
    const TrackingResult& result = tracker.track(slot, {});
    EXPECT_TRUE(result.has_pose()) << i;
    EXPECT_TRUE(test::all_finite(result)) << i;
    most_moved = std::max(most_moved, norm(result.T_odom_camera.t));
  }
  EXPECT_LT(most_moved, 1.0) << "two seconds of turning by hand";
}

}  // namespace
}  // namespace stillmap
