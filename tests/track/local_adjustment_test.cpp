// SPDX-License-Identifier: Apache-2.0
#include "track/local_adjustment.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "posed_scene.h"

namespace stillmap {
namespace {

/// A map of keyframes that all see the same points, as MapBuilder leaves it.
class LocalAdjustmentTest : public testing::Test, protected test::PosedScene {
 protected:
  static constexpr std::size_t kPoints = 120;
  LocalAdjustment adjustment_{arena, camera, static_cast<std::size_t>(config.track.points)};
  std::vector<PointRef> points_;
  std::vector<Vec3> truth_;

  void SetUp() override {
    for (std::size_t i = 0; i < kPoints; ++i) {
      truth_.push_back(anywhere_in_view());
      points_.push_back(add_point(truth_.back(), test::random_descriptor(random)));
    }
  }
  Keyframe& add_keyframe(const Pose& T_odom_camera_true, const Pose& error = {}) {
    Keyframe& keyframe = map.add_keyframe();
    keyframe.T_odom_camera = error * T_odom_camera_true;
    keyframe.stamp_ns = 1'000'000'000 * static_cast<Nanoseconds>(keyframe.id);
    for (std::size_t i = 0; i < kPoints; ++i) {
      const Vec3 p = inverse(T_odom_camera_true) * truth_[i];
      EXPECT_TRUE(
          keyframe.features.try_push_back({static_cast<float>(p.x / p.z), static_cast<float>(p.y / p.z),
                                           static_cast<float>(p.z), 0, points_[i]}));
    }
    return keyframe;
  }
  static Pose step(int n) { return {exp_so3({0, 0.01 * n, 0}), {0.05 * n, 0, 0}}; }
};

TEST_F(LocalAdjustmentTest, MendsTheNewestKeyframeAndTellsItsMove) {
  for (int n = 0; n < 4; ++n) add_keyframe(step(n));
  const Pose error{exp_so3({0.004, -0.003, 0.002}), {0.02, -0.01, 0.015}};
  Keyframe& newest = add_keyframe(step(4), error);
  const Pose before = newest.T_odom_camera;
  adjustment_.offer(map, extractor);
  ASSERT_TRUE(adjustment_.waits());
  EXPECT_FALSE(adjustment_.collect(map)) << "not before the worker has done it";
  adjustment_.work();
  EXPECT_FALSE(adjustment_.waits());
  const std::optional<Pose> move = adjustment_.collect(map);
  ASSERT_TRUE(move);
  EXPECT_LT(norm(newest.T_odom_camera.t - step(4).t), 0.003);
  EXPECT_LT(norm((*move * before).t - newest.T_odom_camera.t), 1e-9);
  EXPECT_FALSE(adjustment_.collect(map)) << "a result is taken once";
}

TEST_F(LocalAdjustmentTest, MendsPoints) {
  for (int n = 0; n < 5; ++n) add_keyframe(step(n));
  MapPoint& point = *map.find(points_[7]);
  point.p_odom = truth_[7] + Vec3{0.05, 0, 0.05};
  point.information = {1, 0, 0, 1, 0, 1};  // nothing that would hold it there
  adjustment_.offer(map, extractor);
  adjustment_.work();
  ASSERT_TRUE(adjustment_.collect(map));
  EXPECT_LT(norm(point.p_odom - truth_[7]), 1e-3);
}

TEST_F(LocalAdjustmentTest, WhatMayMoveHasNoSay) {
  for (int n = 0; n < 5; ++n) add_keyframe(step(n));
  for (std::size_t i = 0; i < kPoints; i += 3) {
    MapPoint& point = *map.find(points_[i]);
    point.suspect = true;
    point.p_odom = truth_[i] + Vec3{0.3, 0, 0};  // it has walked on
  }
  adjustment_.offer(map, extractor);
  adjustment_.work();
  const std::optional<Pose> move = adjustment_.collect(map);
  ASSERT_TRUE(move);
  EXPECT_LT(norm(move->t), 1e-5);
  EXPECT_EQ(map.find(points_[0])->p_odom.x, truth_[0].x + 0.3) << "nor is it moved";
}

TEST_F(LocalAdjustmentTest, NeedsThreeKeyframesThatShareWhatTheySee) {
  add_keyframe(step(0));
  add_keyframe(step(1));
  adjustment_.offer(map, extractor);
  EXPECT_FALSE(adjustment_.waits());
  add_keyframe(step(2)).features.clear();
  adjustment_.offer(map, extractor);
  EXPECT_FALSE(adjustment_.waits());
}

TEST_F(LocalAdjustmentTest, WhatIsGoneMeanwhileIsLeftAlone) {
  for (int n = 0; n < 5; ++n) add_keyframe(step(n));
  Keyframe& newest = *map.newest_keyframe();
  adjustment_.offer(map, extractor);
  adjustment_.work();
  // The slots are given to others before the result is taken.
  newest.id += 100;
  newest.T_odom_camera = step(50);
  const auto slot = static_cast<std::size_t>(points_[3].slot);
  map.remove_point(slot);
  const PointRef other = add_point({9, 9, 9}, test::random_descriptor(random));
  ASSERT_EQ(static_cast<std::size_t>(other.slot), slot);
  ASSERT_TRUE(adjustment_.collect(map));
  EXPECT_EQ(newest.T_odom_camera.t.x, step(50).t.x);
  EXPECT_EQ(map.find(other)->p_odom.x, 9);
}

TEST_F(LocalAdjustmentTest, AWindowFromBeforeACorrectionIsNotTakenBack) {
  for (int n = 0; n < 5; ++n) add_keyframe(step(n));
  Keyframe& newest = *map.newest_keyframe();
  adjustment_.offer(map, extractor);
  adjustment_.outdate();
  newest.T_odom_camera = step(50);
  adjustment_.work();
  EXPECT_FALSE(adjustment_.collect(map));
  EXPECT_EQ(newest.T_odom_camera.t.x, step(50).t.x);
  newest.T_odom_camera = step(4);
  adjustment_.offer(map, extractor);
  adjustment_.work();
  EXPECT_TRUE(adjustment_.collect(map)) << "the next one is";
}

TEST_F(LocalAdjustmentTest, TwoThreadsPassTheWindowToAndFro) {
  for (int n = 0; n < 6; ++n) add_keyframe(step(n));
  std::atomic<bool> end{false};
  std::thread worker([&] {
    while (!end.load()) adjustment_.work();
  });
  int collected = 0;
  while (collected < 20) {
    adjustment_.offer(map, extractor);
    map.find(points_[1])->p_odom = truth_[1];  // the map goes on meanwhile
    collected += adjustment_.collect(map).has_value();
    std::this_thread::yield();
  }
  end = true;
  worker.join();
  for (std::size_t i = 0; i < kPoints; ++i) EXPECT_LT(norm(map.find(points_[i])->p_odom - truth_[i]), 1e-3);
}

}  // namespace
}  // namespace stillmap
