// SPDX-License-Identifier: Apache-2.0
#include "track/tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <vector>

#include "tests/support/heap_calls.h"
#include "tracker_scene.h"

namespace stillmap {
namespace {

using synthetic::PathKind;
using test::Scene;
using test::Tracked;
using test::TrackerScene;

void expect_tracked_throughout(const std::vector<Tracked>& run) {
  for (const Tracked& t : run) {
    EXPECT_EQ(t.result.state, TrackState::Tracking) << "frame " << t.result.sequence;
  }
}

TEST(Tracker, FollowsTheCameraAmongWalkers) {
  TrackerScene scene({.seed = 2, .people = 2});
  const std::vector<Tracked> run = scene.run(0, 60);
  expect_tracked_throughout(run);
  EXPECT_LT(test::drift_rmse_m(run), 0.008);
  const TrackingResult& last = run.back().result;
  EXPECT_GT(last.inliers, 100);
  EXPECT_LE(last.inliers, last.matches);
  EXPECT_LE(last.matches, last.features);
  EXPECT_GT(last.rms_px, 0.05);
  EXPECT_LT(last.rms_px, 4);
  const LabelCounts& labels = last.labels;
  EXPECT_EQ(labels.static_points + labels.dynamic + labels.semi_static + labels.unknown,
            static_cast<std::uint32_t>(last.features));
  EXPECT_EQ(scene.tracker.features().size(), static_cast<std::size_t>(last.features));
  EXPECT_GT(scene.tracker.point_usage().high_water, 500u);
  EXPECT_GE(scene.tracker.keyframe_usage().high_water, 2u);
}

TEST(Tracker, EveryRuleTracksAStillRoom) {
  for (const DynamicRule rule : {DynamicRule::Off, DynamicRule::Paper, DynamicRule::Silhouette}) {
    Config config = test::synthetic_config();
    config.track.dynamic_rule = rule;
    TrackerScene scene({.seed = 4, .people = 0}, config);
    const std::vector<Tracked> run =
        scene.run(0, 10, [&](int, Scene&, DynamicMask& mask) { mask.rule = rule; });
    expect_tracked_throughout(run);
    EXPECT_LT(test::drift_rmse_m(run), 0.008);
  }
}

TEST(Tracker, FollowsATurnOnTheSpot) {
  TrackerScene scene({.seed = 6, .people = 1, .path = PathKind::Rotate});
  const std::vector<Tracked> run = scene.run(0, 40);
  expect_tracked_throughout(run);
  EXPECT_LT(test::drift_rmse_m(run), 0.01);
  const Pose turned = inverse(run.front().T_world_camera) * run.back().T_world_camera;
  const Pose estimated = inverse(run.front().result.T_odom_camera) * run.back().result.T_odom_camera;
  EXPECT_GT(norm(log_so3(turned.R)), 0.2) << "the path does not turn";
  EXPECT_LT(test::angle_between(turned, estimated), 0.01);
}

TEST(Tracker, OdomBeginsAtTheBase) {
  Config config = test::synthetic_config();
  config.mount.T_base_camera = std::array<double, 7>{0.1, 0.2, 0.9, -0.5, 0.5, -0.5, 0.5};
  TrackerScene scene({.seed = 2, .people = 0}, config);
  const Tracked first = scene.step(0);
  EXPECT_NEAR(first.result.T_odom_camera.t.z, 0.9, 1e-12);
  // The optical axis (z) is the base's x.
  EXPECT_LT(norm(first.result.T_odom_camera.R * Vec3{0, 0, 1} - Vec3{1, 0, 0}), 1e-9);
  EXPECT_EQ(norm(scene.tracker.T_base_camera().t - first.result.T_odom_camera.t), 0);
}

TEST(Tracker, TheSameFramesGiveTheSameNumbers) {
  Config config = test::synthetic_config();
  TrackerScene a({.seed = 2, .people = 2}, config), b({.seed = 2, .people = 2}, config);
  for (int i = 0; i < 15; ++i) {
    const TrackingResult one = a.step(i).result, two = b.step(i).result;
    ASSERT_EQ(one.T_odom_camera.R.m, two.T_odom_camera.R.m) << i;
    ASSERT_EQ(norm(one.T_odom_camera.t - two.T_odom_camera.t), 0) << i;
    ASSERT_EQ(one.covariance, two.covariance) << i;
    ASSERT_EQ(one.inliers, two.inliers) << i;
    ASSERT_EQ(one.rms_px, two.rms_px) << i;
  }
}

TEST(Tracker, TakesNothingFromTheHeap) {
  if (!test::counts_heap_calls()) GTEST_SKIP() << "a sanitizer owns the heap";
  synthetic::SyntheticLog log({.seed = 2, .people = 2});
  Arena arena(std::size_t{160} << 20);
  Tracker tracker(arena, test::synthetic_config());
  const long before = test::heap_calls();
  const auto something = std::make_unique<int>(1);
  ASSERT_EQ(test::heap_calls(), before + 1) << "the counter must count, or this test proves nothing";
  int lost = 0;
  for (int i = 0; i < 30; ++i) {
    Scene scene(log, i);
    if (i >= 12 && i < 15) std::fill(scene.truth.colour.begin(), scene.truth.colour.end(), Bgr{});
    DynamicMask mask = scene.mask();
    // Some of the room is semi-static, so that the epipolar check runs too.
    for (std::size_t c = 0; c < 80 * 20; ++c) {
      if (mask.cells[c].label == Label::Static) mask.cells[c] = {1, 8000, Label::SemiStatic, 0};
    }
    const FrameSlot slot = scene.slot(static_cast<std::uint64_t>(i));
    const long calls = test::heap_calls();
    lost += tracker.track(slot, mask).state == TrackState::Lost;
    ASSERT_EQ(test::heap_calls(), calls) << "frame " << i;
  }
  EXPECT_EQ(lost, 3) << "relocalization should have run";
}

TEST(Tracker, PlansWhatItTakes) {
  Arena plan;
  const Tracker planned(plan, test::synthetic_config());
  EXPECT_GT(plan.bytes_planned(), std::size_t{1} << 20);
  Arena arena(plan.bytes_planned());
  const Tracker tracker(arena, test::synthetic_config());
  EXPECT_EQ(arena.bytes_planned(), plan.bytes_planned());
}

/// A tracker with a map for few points forgets, but goes on.
TEST(Tracker, GoesOnWithAFullMap) {
  Config config = test::synthetic_config();
  config.track.points = 1200;
  config.track.keyframes = 8;
  TrackerScene scene({.seed = 2, .people = 0, .path = PathKind::Walk}, config);
  const std::vector<Tracked> run = scene.run(0, 60);
  for (const Tracked& t : run) EXPECT_TRUE(t.result.has_pose()) << t.result.sequence;
  EXPECT_GT(scene.tracker.point_usage().refused, 0u) << "the map was not full";
  EXPECT_LT(test::drift_rmse_m(run), 0.015);
}

/// Carried back to where it began: keyframes remember places longer than the map remembers points.
TEST(Tracker, FindsAPlaceWhosePointsWereGivenUp) {
  Config config = test::synthetic_config();
  config.track.points = 1200;
  synthetic::SyntheticLog log({.seed = 2, .people = 0, .path = PathKind::Walk});
  Arena arena(std::size_t{160} << 20);
  Tracker tracker(arena, config);
  std::vector<Tracked> run;
  const auto see = [&](int index) {
    Scene scene(log, index);
    FrameSlot slot = scene.slot(run.size());
    slot.colour_ns = slot.depth_ns = static_cast<Nanoseconds>(1'000'000'000 + run.size() * 33'333'333);
    run.push_back({tracker.track(slot, scene.mask()), scene.truth.T_world_camera});
  };
  for (int i = 0; i < 320; i += 8) see(i);
  ASSERT_GT(tracker.point_usage().refused, 2000u) << "the map was not full";
  for (int i = 0; i < 3; ++i) see(i);
  for (const Tracked& t : run) {
    EXPECT_TRUE(t.result.has_pose()) << t.result.sequence;
    EXPECT_EQ(t.result.segment, 1u);
  }
  EXPECT_LT(norm(run[40].result.T_odom_camera.t - run[0].result.T_odom_camera.t), 0.02);
  EXPECT_LT(test::drift_rmse_m(run), 0.02);
}

/// The camera stands, then jerks. Depth is exposed a third of a frame after colour: no motion model knows
/// where by then a corner is in it, but the picture does.
TEST(Tracker, KnowsOfAJerkBeforeItReadsDepthAndLabels) {
  constexpr Nanoseconds kFrame_ns = 33'333'333;
  constexpr int kStands = 10, kJerks_to = 16, kDepth_at = 18;
  synthetic::SyntheticLog log({.seed = 6, .people = 0, .path = PathKind::Rotate});
  Arena arena(std::size_t{160} << 20);
  Tracker tracker(arena, test::synthetic_config());
  Scene stands(log, kStands), jerked(log, kJerks_to), at_depth(log, kDepth_at);
  const auto see = [&](Scene& colour, Scene& depth, std::uint64_t sequence, const DynamicMask& mask) {
    FrameSlot slot = colour.slot(sequence);
    slot.depth = depth.slot(sequence).depth;
    slot.colour_ns = static_cast<Nanoseconds>(sequence + 1) * kFrame_ns;
    slot.depth_ns = slot.colour_ns + (&colour == &depth ? 0 : kFrame_ns / 3);
    return tracker.track(slot, mask);
  };
  // Something moves in the right half of the depth picture.
  constexpr int kColumn_px = 320;
  DynamicMask mask = jerked.mask();
  for (int i = 0; i < mask.columns * mask.rows; ++i)
    mask.cells[static_cast<std::size_t>(i)] = i % mask.columns * mask.cell_px >= kColumn_px
                                                  ? DynamicMask::Cell{0, 65535, Label::Dynamic, 0}
                                                  : DynamicMask::Cell{};
  for (std::uint64_t i = 0; i < 4; ++i) see(stands, stands, i, stands.mask());
  ASSERT_TRUE(see(jerked, at_depth, 4, mask).has_pose());

  const CameraModel camera = synthetic::SyntheticLog::camera();
  const Pose T_depth_colour = inverse(at_depth.truth.T_world_camera) * jerked.truth.T_world_camera;
  int seen = 0, right_depth = 0, at_edge = 0, right_label = 0;
  for (const Feature& f : tracker.features()) {
    const double truth_m = camera.depth_m(jerked.depth().at(static_cast<int>(f.x), static_cast<int>(f.y)));
    if (f.depth_m == 0 || truth_m == 0) continue;
    ++seen;
    right_depth += std::abs(f.depth_m - truth_m) < 0.03 * truth_m ? 1 : 0;
    const Vec2 there = camera.project(T_depth_colour * (truth_m * Vec3{f.ray_x, f.ray_y, 1}));
    const double from_edge_px = std::abs(there.x - kColumn_px);
    if (from_edge_px < 2 || from_edge_px > 12) continue;  // the turn is of 14 px
    ++at_edge;
    right_label += (f.label == Label::Dynamic) == (there.x > kColumn_px) ? 1 : 0;
  }
  ASSERT_GT(seen, 500);
  ASSERT_GT(at_edge, 20);
  // The rest is where surfaces end.
  EXPECT_GT(right_depth, seen * 75 / 100) << "67 % where the motion model says how the camera turns";
  EXPECT_GT(right_label, at_edge * 85 / 100);
}

/// A camera that turns evenly, whose rows are exposed one after the other, in three bands here; depth as
/// sensors give it, of one instant.
TEST(Tracker, ReadsDepthWhereAnInstantsPictureWouldHaveTheCorner) {
  constexpr Nanoseconds kFrame_ns = 33'333'333;
  constexpr int kStep = 4, kFrames = 5;  // of the rendered log's frames, one each frame
  constexpr std::ptrdiff_t kBand_px = 160 * 640;
  synthetic::SyntheticLog log({.seed = 6, .people = 0, .path = PathKind::Rotate});
  Arena arena(std::size_t{160} << 20);
  Config config = test::synthetic_config();
  config.camera.readout_s = 3.0 / kStep / 30;
  Tracker tracker(arena, config);
  std::vector<Scene> bands;
  TrackingResult result;
  for (int i = 0; i < kFrames; ++i) {
    bands.clear();
    for (int band = 0; band < 3; ++band) bands.emplace_back(log, 10 + kStep * i + band);
    std::vector<Bgr> colour;
    for (const Scene& band : bands)
      std::copy_n(band.truth.colour.begin() + std::ssize(colour), kBand_px, std::back_inserter(colour));
    FrameSlot slot = bands[1].slot(static_cast<std::uint64_t>(i));
    slot.colour = {colour.data(), 640, 480, 640};
    slot.colour_ns = slot.depth_ns = (i + 1) * kFrame_ns;
    result = tracker.track(slot, bands[1].mask());
    ASSERT_TRUE(result.has_pose());
  }
  const CameraModel camera = synthetic::SyntheticLog::camera();
  const Scene& instant = bands[1];
  const auto depth_m = [&](Vec2 pixel) {
    return camera.depth_m(instant.depth().at(std::clamp(static_cast<int>(pixel.x), 0, 639),
                                             std::clamp(static_cast<int>(pixel.y), 0, 479)));
  };
  int seen = 0, right_depth = 0;
  for (const Feature& f : tracker.features()) {
    const double truth_m = depth_m({f.x, f.y});
    if (f.depth_m == 0 || truth_m == 0) continue;
    const Pose T_band_instant = inverse(bands[static_cast<std::size_t>(f.y) / 160].truth.T_world_camera) *
                                instant.truth.T_world_camera;
    const double as_exposed_m =
        depth_m(camera.project(T_band_instant * (truth_m * Vec3{f.ray_x, f.ray_y, 1})));
    if (std::abs(as_exposed_m - truth_m) < 0.06 * truth_m) continue;  // where it makes no difference
    ++seen;
    right_depth += std::abs(f.depth_m - truth_m) < 0.03 * truth_m ? 1 : 0;
  }
  ASSERT_GT(seen, 30);
  EXPECT_GT(right_depth, seen * 90 / 100);
  EXPECT_GT(result.matches, 360) << "315 with rows as they come";
}

}  // namespace
}  // namespace stillmap
