// SPDX-License-Identifier: Apache-2.0
// The tracker with a robot that says how it moves, beside the same one that is told nothing.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/heap_calls.h"
#include "tracker_scene.h"

namespace stillmap {
namespace {

using test::Scene;
using test::Tracked;
using test::TrackerScene;

constexpr int kLast = 12, kAfter = 40;  // the last frame before the dark, the first one after it

class TrackerOdometry : public testing::Test {
 protected:
  static synthetic::SyntheticOptions options() { return {.seed = 2, .people = 0}; }
  static Config config() {
    Config c = test::synthetic_config();
    // A camera on a mast: ahead of the base's middle, above it, and looking ahead.
    c.mount.T_base_camera = std::array<double, 7>{0.1, 0.2, 0.9, -0.5, 0.5, -0.5, 0.5};
    return c;
  }
  /// What wheels would say of the camera's true way, from one frame to the next.
  void tell(int from, int to) {
    const Pose T_base_camera = told_.tracker.T_base_camera();
    for (int i = from; i < to; ++i) {
      const auto base = [&](int index) {
        return told_.log.T_world_camera(told_.log.stamp_ns(index)) * inverse(T_base_camera);
      };
      ASSERT_TRUE(told_.tracker.odometry().try_push({told_.log.stamp_ns(i), told_.log.stamp_ns(i + 1),
                                                     inverse(base(i)) * base(i + 1), 0.0005, 0.0005}));
    }
  }
  /// How far from the truth a pose is, both as seen from the last frame before the dark.
  double error_m(const Tracked& last, const Pose& T_odom_camera, int index) {
    const Pose truth = inverse(last.T_world_camera) * told_.log.T_world_camera(told_.log.stamp_ns(index));
    return norm((inverse(last.result.T_odom_camera) * T_odom_camera).t - truth.t);
  }
  /// Only a hole in the middle is left of the picture.
  static void peep(int, Scene& scene, DynamicMask&) {
    for (int y = 0; y < 480; ++y) {
      for (int x = 0; x < 640; ++x) {
        const bool in_hole = x >= kHoleX && x < kHoleX + kHole && y >= kHoleY && y < kHoleY + kHole;
        if (!in_hole) scene.truth.colour[static_cast<std::size_t>(640 * y + x)] = {};
      }
    }
  }
  static constexpr int kHoleX = 260, kHoleY = 180, kHole = 120;

  TrackerScene told_{options(), config()}, untold_{options(), config()};
};

TEST_F(TrackerOdometry, BridgesWhatTheCameraDoesNotSee) {
  const std::vector<Tracked> told = told_.run(0, kLast + 1), untold = untold_.run(0, kLast + 1);
  tell(0, kAfter);
  const Nanoseconds after_ns = told_.log.stamp_ns(kAfter);
  EXPECT_LT(error_m(told.back(), told_.tracker.predict(after_ns), kAfter), 1e-6);
  EXPECT_GT(error_m(untold.back(), untold_.tracker.predict(after_ns), kAfter), 0.1)
      << "the path stands still";

  const auto darken = [](int, Scene& scene, DynamicMask&) {
    std::fill(scene.truth.colour.begin(), scene.truth.colour.end(), Bgr{});
  };
  for (TrackerScene* scene : {&told_, &untold_})
    EXPECT_EQ(scene->step(kAfter - 1, darken).result.state, TrackState::Lost);
  const Tracked found = told_.step(kAfter, peep), missed = untold_.step(kAfter, peep);
  EXPECT_TRUE(found.result.has_pose()) << found.result.matches << " of " << found.result.features;
  EXPECT_LT(error_m(told.back(), found.result.T_odom_camera, kAfter), 0.02);
  EXPECT_FALSE(missed.result.has_pose())
      << "the hole shows enough without being told: " << missed.result.inliers;
}

/// What the camera sees plainly it believes more than wheels that slip.
TEST_F(TrackerOdometry, DoesNotOutweighWhatIsSeen) {
  static_cast<void>(told_.run(0, kLast));
  for (int i = kLast - 1; i < kLast + 8; ++i) {  // wheels that spin on the spot, and are sure of it
    ASSERT_TRUE(told_.tracker.odometry().try_push(
        {told_.log.stamp_ns(i), told_.log.stamp_ns(i + 1), Pose{{}, {0.02, 0, 0}}, 0.0005, 0.0005}));
  }
  const std::vector<Tracked> run = told_.run(kLast, kLast + 8);
  for (const Tracked& t : run) EXPECT_EQ(t.result.state, TrackState::Tracking) << t.result.sequence;
  EXPECT_LT(test::drift_rmse_m(run), 0.008);
}

TEST_F(TrackerOdometry, TakesNothingFromTheHeap) {
  static_cast<void>(told_.run(0, kLast));
  tell(0, kLast + 1);
  Scene scene(told_.log, kLast);
  const FrameSlot slot = scene.slot(kLast);
  const DynamicMask mask = scene.mask();
  const long before = test::heap_calls();
  static_cast<void>(told_.tracker.track(slot, mask));
  EXPECT_EQ(test::heap_calls(), before);
}

}  // namespace
}  // namespace stillmap
