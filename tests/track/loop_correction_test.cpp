// SPDX-License-Identifier: Apache-2.0
#include "track/loop_correction.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "scene.h"

namespace stillmap {
namespace {

using test::angle_between;

/// A ring of keyframes around a table, whose odometry drifts; keyframe i sees four points of its own.
class LoopCorrectionTest : public testing::Test {
 protected:
  static constexpr std::size_t kKeyframes = 30, kPoints = 400;

  void walk(int keyframes, const Pose& drift_per_step) {
    Pose T = truth(0);
    for (int i = 0; i < keyframes; ++i) {
      if (i > 0) T = T * (inverse(truth(i - 1)) * truth(i)) * drift_per_step;
      add(T, i);
    }
  }
  Keyframe& add(const Pose& T_odom_camera, int number) {
    Keyframe& k = map.add_keyframe();
    k.T_odom_camera = T_odom_camera;
    k.stamp_ns = 1'000'000 * number;
    for (int j = 0; j < 4; ++j) {
      MapPoint point;
      const Vec3 p_camera{0.3 * j - 0.5, 0.1 * j, 1.5 + 0.2 * j};
      point.p_odom = T_odom_camera * p_camera;
      point.view_direction = T_odom_camera.R * Vec3{0, 0, -1};
      point.information = {1e4, 10, 20, 2e4, 30, 3e4};
      point.made_ns = k.stamp_ns;
      EXPECT_TRUE(k.features.try_push_back({0, 0, 1, 0, map.add_point(point)}));
    }
    return k;
  }
  static Pose truth(int i) {
    const double angle = 2 * std::numbers::pi * i / 25;
    return {exp_so3({0, 0, angle}), {2 * std::cos(angle), 2 * std::sin(angle), 0}};
  }
  LoopEdge loop(const Keyframe& a, const Keyframe& b, const Pose& T_a_b) {
    LoopEdge edge{.keyframe_a = a.id, .keyframe_b = b.id, .T_a_b = T_a_b};
    for (std::size_t i = 0; i < 6; ++i) edge.information[7 * i] = i < 3 ? 1e4 : 4e3;
    return edge;
  }
  std::optional<Pose> correct(const LoopEdge& edge) {
    if (!correction.prepare(map, edge)) return std::nullopt;
    correction.solve();
    return correction.apply(map);
  }
  /// How far the newest keyframe is from where it should be, as seen from keyframe `from`.
  double off_m(std::size_t from, std::size_t newest) const {
    const Pose T = inverse(map.keyframes()[from].T_odom_camera) * map.keyframes()[newest].T_odom_camera;
    return norm(T.t - (inverse(truth(static_cast<int>(from))) * truth(static_cast<int>(newest))).t);
  }
  Arena arena{std::size_t{16} << 20};
  LocalMap map{arena, kKeyframes, kPoints};
  LoopCorrection correction{arena, kKeyframes, kPoints};
  const Pose kDrift{exp_so3({0.002, -0.001, 0.006}), {0.006, -0.004, 0.005}};
};

TEST_F(LoopCorrectionTest, ThePastMovesAndThePresentStays) {
  walk(25, kDrift);
  const double drift = off_m(0, 24);
  ASSERT_GT(drift, 0.15);
  const std::vector<Keyframe> before(map.keyframes().begin(), map.keyframes().end());
  const std::vector<MapPoint> points(map.points().begin(), map.points().end());
  const auto change = correct(loop(map.keyframes()[24], map.keyframes()[0], inverse(truth(24)) * truth(0)));
  ASSERT_TRUE(change);
  EXPECT_EQ(correction.result().state, PoseGraphState::Converged);
  EXPECT_LT(off_m(0, 24), 0.3 * drift);
  EXPECT_LT(off_m(12, 24), off_m(0, 12) + drift);
  const Pose &newest = map.keyframes()[24].T_odom_camera, &oldest = map.keyframes()[0].T_odom_camera;
  EXPECT_LT(norm(newest.t - before[24].T_odom_camera.t), 1e-12) << "odom does not jump";
  EXPECT_LT(angle_between(newest, before[24].T_odom_camera), 1e-7);
  // With map -> odom the identity before, the oldest keyframe stays where it was in the map.
  EXPECT_LT(norm((*change * oldest).t - before[0].T_odom_camera.t), 1e-9);
  EXPECT_LT(angle_between(*change * oldest, before[0].T_odom_camera), 1e-7);
  for (std::size_t k = 0; k < 25; ++k) {
    const Keyframe& keyframe = map.keyframes()[k];
    for (const KeyframeFeature& f : keyframe.features) {
      const MapPoint &now = *map.find(f.point), &then = points[static_cast<std::size_t>(f.point.slot)];
      const Vec3 seen = inverse(keyframe.T_odom_camera) * now.p_odom;
      EXPECT_LT(norm(seen - inverse(before[k].T_odom_camera) * then.p_odom), 1e-9)
          << "goes with its keyframe";
      const Vec3 direction = transposed(keyframe.T_odom_camera.R) * now.view_direction;
      EXPECT_LT(norm(direction - Vec3{0, 0, -1}), 1e-9);
      EXPECT_NEAR(now.information[0] + now.information[3] + now.information[5], 6e4, 1e-3)
          << "turned, no more";
    }
  }
}

TEST_F(LoopCorrectionTest, ALoopThatCannotBeLeavesTheMapAlone) {
  walk(25, {});
  const std::vector<Keyframe> before(map.keyframes().begin(), map.keyframes().end());
  EXPECT_FALSE(correct(loop(map.keyframes()[20], map.keyframes()[3], {exp_so3({0, 2, 0}), {3, 3, 3}})));
  for (std::size_t k = 0; k < 25; ++k)
    EXPECT_EQ(norm(map.keyframes()[k].T_odom_camera.t - before[k].T_odom_camera.t), 0);
  EXPECT_TRUE(correct(loop(map.keyframes()[24], map.keyframes()[0], inverse(truth(24)) * truth(0))))
      << "and does not spoil the next";
  EXPECT_EQ(correction.result().refused_loops, 0);
}

TEST_F(LoopCorrectionTest, ASegmentIsJoinedHoweverFarAstray) {
  walk(10, {});
  const Pose astray{exp_so3({0.5, -1, 2}), {8, -3, 2}};
  map.begin_segment();
  for (int i = 10; i < 16; ++i) add(astray * truth(i), i);
  const auto change = correct(loop(map.keyframes()[15], map.keyframes()[4], inverse(truth(15)) * truth(4)));
  ASSERT_TRUE(change);
  EXPECT_EQ(map.keyframes()[0].segment, map.keyframes()[15].segment) << "they are one now";
  for (const MapPoint& p : map.points()) EXPECT_TRUE(!p.alive || map.in_segment(p));
  for (std::size_t k = 0; k < 15; ++k) EXPECT_LT(off_m(k, 15), 2e-3) << k;
  for (int k = 0; k < 16; ++k) {
    const Pose T_map_camera = *change * map.keyframes()[static_cast<std::size_t>(k)].T_odom_camera;
    EXPECT_LT(norm(T_map_camera.t - truth(k).t), 2e-3) << "the map is the older segment's";
  }
}

/// Three segments: the camera was lost twice. What is known of two says nothing of the third.
TEST_F(LoopCorrectionTest, ASegmentOfWhichNothingIsKnownStaysApart) {
  walk(8, {});
  map.begin_segment();
  const Pose anywhere{exp_so3({0, 1, 0}), {-5, 1, 0}}, astray{exp_so3({0.5, -1, 2}), {8, -3, 2}};
  for (int i = 8; i < 12; ++i) add(anywhere * truth(i), i);
  const std::uint32_t apart = map.segment();
  map.begin_segment();
  for (int i = 12; i < 18; ++i) add(astray * truth(i), i);
  const std::vector<Keyframe> before(map.keyframes().begin(), map.keyframes().end());
  const std::vector<MapPoint> points(map.points().begin(), map.points().end());
  ASSERT_TRUE(correct(loop(map.keyframes()[17], map.keyframes()[4], inverse(truth(17)) * truth(4))));
  for (std::size_t k = 0; k < 8; ++k) EXPECT_LT(off_m(k, 17), 2e-3) << k;
  for (std::size_t k = 8; k < 12; ++k) {
    EXPECT_EQ(map.keyframes()[k].segment, apart);
    EXPECT_EQ(norm(map.keyframes()[k].T_odom_camera.t - before[k].T_odom_camera.t), 0) << k;
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (points[i].alive && points[i].segment == apart) {
      EXPECT_EQ(norm(map.points()[i].p_odom - points[i].p_odom), 0);
    }
  }
  // It is joined once it is known, too, and an earlier loop goes on to count.
  EXPECT_TRUE(correct(loop(map.keyframes()[10], map.keyframes()[5], inverse(truth(10)) * truth(5))));
  EXPECT_EQ(map.keyframes()[9].segment, map.segment());
  for (std::size_t k = 0; k < 17; ++k) EXPECT_LT(off_m(k, 17), 5e-3) << k;
}

/// Lost, elsewhere for a while, and found again in the first segment.
TEST_F(LoopCorrectionTest, ASegmentThatWasLeftAndEnteredAgainHoldsTogether) {
  walk(8, {});
  const std::uint32_t first = map.segment();
  map.begin_segment();
  const std::uint32_t second = map.segment();
  const Pose astray{exp_so3({0.5, -1, 2}), {8, -3, 2}};
  for (int i = 8; i < 12; ++i) add(astray * truth(i), i);
  map.enter_segment(first);
  for (int i = 12; i < 16; ++i) add(truth(i), i);
  ASSERT_TRUE(correct(loop(map.keyframes()[15], map.keyframes()[10], inverse(truth(15)) * truth(10))));
  EXPECT_NE(first, second);
  for (std::size_t k = 0; k < 16; ++k) EXPECT_EQ(map.keyframes()[k].segment, map.segment());
  for (std::size_t k = 0; k < 15; ++k) EXPECT_LT(off_m(k, 15), 2e-3) << k;
}

TEST_F(LoopCorrectionTest, PointsThatTwoKeyframesShareHoldThemTogether) {
  walk(25, kDrift);
  // Keyframes 10 and 2 were tied by tracking; a chain alone would let the loop part them.
  Keyframe &older = map.keyframes()[2], &newer = map.keyframes()[10];
  for (int i = 0; i < 60; ++i) {
    const KeyframeFeature shared{0, 0, 1, 0, map.add_point({})};
    ASSERT_TRUE(older.features.try_push_back(shared));
    ASSERT_TRUE(newer.features.try_push_back(shared));
  }
  const Pose before = inverse(older.T_odom_camera) * newer.T_odom_camera;
  ASSERT_TRUE(correct(loop(map.keyframes()[24], map.keyframes()[0], inverse(truth(24)) * truth(0))));
  const double tied = norm((inverse(older.T_odom_camera) * newer.T_odom_camera).t - before.t);
  EXPECT_LT(tied, 0.04);
}

TEST_F(LoopCorrectionTest, TheMapMayGrowMeanwhile) {
  walk(30, kDrift);  // full: the next keyframe takes a slot
  const LoopEdge edge = loop(map.keyframes()[24], map.keyframes()[0], inverse(truth(24)) * truth(0));
  ASSERT_TRUE(correction.prepare(map, edge));
  const Pose T_new{{}, {7, 8, 9}};
  const Keyframe& added = add(T_new, 30);
  const PointRef new_point = added.features[0].point;
  const Vec3 p = map.find(new_point)->p_odom;
  correction.solve();
  ASSERT_TRUE(correction.apply(map));
  EXPECT_EQ(norm(added.T_odom_camera.t - T_new.t), 0) << "newer than the newest of the graph";
  EXPECT_LT(norm(map.find(new_point)->p_odom - p), 1e-9);
}

TEST_F(LoopCorrectionTest, AnEndThatHasLeftTheMapIsNoLoop) {
  walk(5, {});
  LoopEdge edge = loop(map.keyframes()[4], map.keyframes()[0], inverse(truth(4)) * truth(0));
  edge.keyframe_b = 77;
  EXPECT_FALSE(correction.prepare(map, edge));
  EXPECT_FALSE(correct(edge));
}

}  // namespace
}  // namespace stillmap
