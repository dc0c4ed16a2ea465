// SPDX-License-Identifier: Apache-2.0
#include "track/loop_closer.h"

#include <gtest/gtest.h>

#include <vector>

#include "keyframe_scene.h"

namespace stillmap {
namespace {

using test::angle_between;
using test::corners_before;
using test::SceneCorner;

TEST(IsConvincing, EveryMeasureHasItsSay) {
  ViewMatch sound;
  sound.agreeing_pairs = 80;
  sound.inliers = 150;
  sound.depths = 350;
  sound.agreeing_depths = 330;
  sound.spread = 0.1;
  sound.sigma_m = 0.016;
  sound.sigma_rad = 0.011;
  EXPECT_TRUE(sound.is_convincing());
  const auto but = [&](auto change) {
    ViewMatch m = sound;
    change(m);
    return m.is_convincing();
  };
  EXPECT_FALSE(but([](ViewMatch& m) { m.agreeing_pairs = 12; })) << "agree by chance";
  EXPECT_FALSE(but([](ViewMatch& m) { m.inliers = 40; }));
  EXPECT_FALSE(but([](ViewMatch& m) { m.depths = m.agreeing_depths = 30; })) << "hardly any depth to compare";
  EXPECT_FALSE(but([](ViewMatch& m) { m.agreeing_depths = 240; })) << "another depth picture";
  EXPECT_FALSE(but([](ViewMatch& m) { m.spread = 0.02; })) << "all on one thing";
  EXPECT_FALSE(but([](ViewMatch& m) { m.sigma_m = 0.1; }));
  EXPECT_FALSE(but([](ViewMatch& m) { m.sigma_rad = 0.05; }));
}

/// A walk that leaves a place and comes back to it, in made-up keyframes.
class LoopCloserTest : public testing::Test {
 protected:
  static constexpr std::size_t kKeyframes = 40;

  /// A keyframe of the ring at `T_world_camera`, as odometry with `drift` has it.
  std::size_t add(const Pose& T_world_camera, const std::vector<SceneCorner>& corners,
                  const Pose& drift = {}) {
    Keyframe& keyframe = map.add_keyframe();
    test::see(config.camera, T_world_camera, corners, keyframe);
    keyframe.T_odom_camera = drift * T_world_camera;
    const auto slot = static_cast<std::size_t>(&keyframe - map.keyframes().data());
    places.insert(slot, {keyframe.descriptors.data(), keyframe.features.size()});
    return slot;
  }
  void walk_away(int keyframes) {
    for (int i = 0; i < keyframes; ++i) {
      const Pose T{{}, {10.0 + i, 0, 0}};
      add(T, corners_before(T, 100, random));
    }
  }
  void begin(std::size_t slot) {
    closer.ask(map, slot);
    // So many frames as it takes: some of the keyframe's features in each.
    for (int frame = 0; frame < 10; ++frame) closer.gather(map);
  }
  std::optional<LoopEdge> ask(std::size_t slot) {
    begin(slot);
    std::optional<LoopEdge> found;
    while (closer.prepare(map, Random(3))) {
      closer.compare();
      if (const auto edge = closer.judge(map)) found = edge;
    }
    return found;
  }
  static Pose step(int i) { return {exp_so3({0, 0.03 * i, 0}), {0.08 * i, 0, 0.02 * i}}; }

  Config config = test::synthetic_config();
  Arena arena{test::kArenaBytes};
  LocalMap map{arena, kKeyframes, static_cast<std::size_t>(config.track.points)};
  PlaceIndex places{arena, kKeyframes, kMaxFeatures};
  LoopCloser closer{arena, config.track, config.camera, places};
  Random random{9};
  std::vector<SceneCorner> here = corners_before({}, 500, random);
  const Pose kDrift{exp_so3({0.02, -0.05, 0.01}), {0.3, -0.2, 0.1}};
};

TEST_F(LoopCloserTest, TwoKeyframesThatComeBackCloseALoop) {
  const std::size_t first = add(step(0), here), second = add(step(1), here);
  walk_away(20);
  const std::size_t third = add(step(2), here, kDrift);
  EXPECT_FALSE(ask(third)) << "one sighting is not enough";
  EXPECT_EQ(closer.counts().verified, 1u);
  const std::size_t fourth = add(step(3), here, kDrift);
  const auto edge = ask(fourth);
  ASSERT_TRUE(edge);
  EXPECT_EQ(edge->keyframe_a, map.keyframes()[fourth].id);
  const std::uint32_t b = edge->keyframe_b;
  ASSERT_TRUE(b == map.keyframes()[first].id || b == map.keyframes()[second].id);
  const Pose truth = inverse(step(3)) * (b == map.keyframes()[first].id ? step(0) : step(1));
  EXPECT_LT(norm(edge->T_a_b.t - truth.t), 1e-3) << "whatever the odometry says";
  EXPECT_LT(angle_between(edge->T_a_b, truth), 1e-3);
  EXPECT_GT(edge->inliers, 100);
  EXPECT_EQ(closer.counts().closed, 1u);
  EXPECT_FALSE(ask(add(step(4), here, kDrift))) << "the next loop takes two sightings again";
  EXPECT_TRUE(ask(add(step(5), here, kDrift)));
}

TEST_F(LoopCloserTest, WhatWasSeenAMomentAgoIsNoLoop) {
  add(step(0), here);
  walk_away(3);
  EXPECT_FALSE(ask(add(step(1), here)));
  EXPECT_FALSE(ask(add(step(2), here)));
  EXPECT_EQ(closer.counts().compared, 0u);
}

TEST_F(LoopCloserTest, ANewSegmentIsJoinedToAnOlderOneAtOnce) {
  add(step(0), here);
  add(step(1), here);
  map.begin_segment();
  const Pose astray{exp_so3({0.4, 1, -2}), {-7, 3, 1}};
  const std::size_t third = add(step(2), here, astray), fourth = add(step(3), here, astray);
  EXPECT_FALSE(ask(third));
  const auto edge = ask(fourth);
  ASSERT_TRUE(edge);
  EXPECT_LT(edge->keyframe_b, map.keyframes()[third].id);
}

TEST_F(LoopCloserTest, KeyframesThatSharePointsNeedNoLoop) {
  const std::size_t first = add(step(0), here);
  walk_away(20);
  const std::size_t back = add(step(0), here);
  Keyframe &a = map.keyframes()[back], &b = map.keyframes()[first];
  for (std::size_t i = 0; i < 20; ++i) {
    const PointRef point = map.add_point({});
    a.features[i].point = b.features[i].point = point;
  }
  EXPECT_FALSE(ask(back));
  EXPECT_EQ(closer.counts().compared, 0u);
  // The same slots, but the points have died and others live there.
  for (std::size_t i = 0; i < 20; ++i) ++a.features[i].point.id;
  ask(back);
  EXPECT_GT(closer.counts().compared, 0u);
}

TEST_F(LoopCloserTest, SightingsThatDisagreeCloseNothing) {
  add(step(0), here);
  walk_away(20);
  EXPECT_FALSE(ask(add(step(1), here, kDrift)));
  // Odometry says that the camera has moved half a metre since; the place says that it has not.
  const Pose jump{{}, {0.5, 0, 0}};
  EXPECT_FALSE(ask(add(step(2), here, jump * kDrift)));
  EXPECT_EQ(closer.counts().verified, 2u);
  EXPECT_EQ(closer.counts().closed, 0u);
}

TEST_F(LoopCloserTest, AnOldSightingConfirmsNothing) {
  add(step(0), here);
  walk_away(16);
  EXPECT_FALSE(ask(add(step(1), here)));
  walk_away(10);
  EXPECT_FALSE(ask(add(step(2), here))) << "too long ago";
  EXPECT_EQ(closer.counts().verified, 2u);
}

TEST_F(LoopCloserTest, OneQuestionAtATime) {
  add(step(0), here);
  walk_away(20);
  const std::size_t back = add(step(1), here);
  begin(back);
  ASSERT_TRUE(closer.busy());
  begin(back);
  EXPECT_EQ(closer.counts().skipped, 1u);
  ASSERT_TRUE(closer.prepare(map, Random(3)));
  closer.compare();
  closer.judge(map);
  EXPECT_FALSE(closer.prepare(map, Random(3))) << "sure of the place, so the others are not compared";
  EXPECT_FALSE(closer.busy());
}

TEST_F(LoopCloserTest, AQuestionAboutWhatManyKeyframesShowIsSpreadOverFrames) {
  const auto seen_by = [&](int keyframes) {
    for (int i = 0; i < keyframes; ++i) add(step(0), here);
  };
  seen_by(1);
  walk_away(20);
  const std::size_t back = add(step(1), here);
  const auto frames = [&] {
    int taken = 0;
    for (closer.ask(map, back); !closer.prepare(map, Random(3)); ++taken) closer.gather(map);
    return taken;
  };
  EXPECT_EQ(frames(), 1) << "500 features are met twice in five tables";
  closer.compare();
  closer.judge(map);
  seen_by(6);
  EXPECT_EQ(frames(), 3) << "eight times";
  closer.compare();
  closer.judge(map);
  closer.ask(map, back);
  closer.gather(map);
  EXPECT_TRUE(closer.busy());
  map.keyframes()[back].alive = false;
  closer.gather(map);
  EXPECT_FALSE(closer.busy()) << "who asked is gone";
}

TEST_F(LoopCloserTest, ARingThatMovesOnEndsTheQuestion) {
  const std::size_t first = add(step(0), here);
  walk_away(20);
  const std::size_t back = add(step(1), here);
  begin(back);
  const std::uint32_t id = map.keyframes()[first].id;
  map.keyframes()[first].id = 1000;  // another keyframe lives there now
  EXPECT_FALSE(closer.prepare(map, Random(3)));
  map.keyframes()[first].id = id;
  begin(back);
  ASSERT_TRUE(closer.prepare(map, Random(3)));
  closer.compare();  // of copies, whatever becomes of the map
  map.keyframes()[first].alive = false;
  EXPECT_FALSE(closer.judge(map));
  map.keyframes()[first].alive = true;
  EXPECT_FALSE(ask(add(step(2), here))) << "what was judged too late is no sighting that this could confirm";
  begin(back);
  map.keyframes()[back].alive = false;
  EXPECT_FALSE(closer.prepare(map, Random(3)));
  EXPECT_FALSE(closer.busy());
}

TEST_F(LoopCloserTest, ANewPlaceClosesNothing) {
  for (int i = 0; i < 35; ++i) {
    const Pose T{{}, {3.0 * i, 0, 0}};
    EXPECT_FALSE(ask(add(T, corners_before(T, 300, random))));
  }
  EXPECT_EQ(closer.counts().asked, 35u);
  EXPECT_EQ(closer.counts().verified, 0u);
}

}  // namespace
}  // namespace stillmap
