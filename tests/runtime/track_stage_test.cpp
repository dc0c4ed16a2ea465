// SPDX-License-Identifier: Apache-2.0
#include "runtime/track_stage.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/runtime/wall_scene.h"

namespace stillmap {
namespace {

using test::WallScene;

struct TrackStageBench {
  TrackStageBench()
      : config(WallScene::config()),
        arena(96 << 20),
        pool(arena, 2, WallScene::kWidth, WallScene::kHeight),
        stage(arena, config) {}

  const TrackingResult& step(int index, bool dark = false) {
    frame.reset();
    frame = pool.acquire();
    scene.draw(index, frame.writable());
    FrameSlot& slot = frame.writable();
    for (int y = 0; dark && y < slot.colour.height; ++y) {
      std::fill_n(slot.colour.row(y), slot.colour.width, Bgr{});
      std::fill_n(slot.depth.row(y), slot.depth.width, std::uint16_t{0});
    }
    slot.sequence = static_cast<std::uint64_t>(index);
    return stage.step(slot);
  }
  static Detections boxes(int index) {
    Detections boxes{static_cast<std::uint64_t>(index), WallScene::stamp_ns(index), {}};
    EXPECT_TRUE(boxes.items.try_push_back({WallScene::thing(index), 0, ClassKind::Dynamic, 0.9f, 1}));
    return boxes;
  }
  PosedFrame posed() const {
    PosedFrame out;
    stage.fill_posed(frame, out);
    return out;
  }

  WallScene scene;
  Config config;
  Arena arena;
  FramePool pool;
  FrameHandle frame;
  TrackStage stage;
};

float overlap(const Box& a, const Box& b) {
  const float w = std::max(0.f, std::min(a.x1, b.x1) - std::max(a.x0, b.x0));
  const float h = std::max(0.f, std::min(a.y1, b.y1) - std::max(a.y0, b.y0));
  return w * h / (a.area() + b.area() - w * h);
}

TEST(TrackStage, FollowsTheCamera) {
  TrackStageBench bench;
  for (int i = 0; i < 15; ++i) ASSERT_TRUE(bench.step(i).has_pose()) << i;
  const PosedFrame posed = bench.posed();
  EXPECT_EQ(posed.frame->sequence, 14u);
  EXPECT_NEAR(norm(posed.T_map_colour.t - WallScene::T_first_camera(14).t), 0, 0.01);
  EXPECT_NEAR(norm(posed.T_map_depth.t - posed.T_map_colour.t), 0, 0.01);  // depth and colour have one stamp
  EXPECT_FALSE(posed.boxes_are_its_own);
  EXPECT_EQ(bench.stage.box_supply().none, 15u);
}

TEST(TrackStage, BoxesOfTheComingFrameAreItsOwn) {
  TrackStageBench bench;
  for (int i = 0; i < 5; ++i) {
    bench.stage.take_boxes(TrackStageBench::boxes(i));
    ASSERT_TRUE(bench.step(i).has_pose());
    const PosedFrame posed = bench.posed();
    EXPECT_TRUE(posed.boxes_are_its_own);
    ASSERT_EQ(posed.mask.boxes.items.size(), 1u);
    EXPECT_GT(overlap(posed.mask.boxes.items[0].box, WallScene::thing(i)), 0.95f);
    EXPECT_EQ(posed.mask.boxes.sequence, static_cast<std::uint64_t>(i));
  }
  EXPECT_EQ(bench.stage.box_supply().fresh, 5u);
}

TEST(TrackStage, LateBoxesAreCarriedToTheFrameAtHand) {
  TrackStageBench bench;
  constexpr int kLate = 4;
  for (int i = 0; i < 16; ++i) {
    if (i >= kLate) bench.stage.take_boxes(TrackStageBench::boxes(i - kLate));
    ASSERT_TRUE(bench.step(i).has_pose());
    if (i < 2 * kLate) continue;  // the velocity needs two sightings
    const PosedFrame posed = bench.posed();
    EXPECT_FALSE(posed.boxes_are_its_own);
    ASSERT_EQ(posed.mask.boxes.items.size(), 1u) << i;
    EXPECT_GT(overlap(posed.mask.boxes.items[0].box, WallScene::thing(i)), 0.7f) << i;
  }
  EXPECT_EQ(bench.stage.box_supply().none, static_cast<std::uint64_t>(kLate));
  EXPECT_EQ(bench.stage.box_supply().carried, 12u);
  EXPECT_EQ(bench.stage.box_supply().fresh, 0u);
}

TEST(TrackStage, BoxesOfAFrameThatNeverCameSayNothing) {
  TrackStageBench bench;
  ASSERT_TRUE(bench.step(0).has_pose());
  bench.stage.take_boxes(TrackStageBench::boxes(1));  // frame 1 is skipped
  ASSERT_TRUE(bench.step(2).has_pose());
  ASSERT_TRUE(bench.step(3).has_pose());
  EXPECT_EQ(bench.stage.box_supply().none, 3u);
}

TEST(TrackStage, BoxesGoWithThePoseThatTheyWereCarriedBy) {
  TrackStageBench bench;
  for (int i = 0; i < 5; ++i) {
    bench.stage.take_boxes(TrackStageBench::boxes(i));
    ASSERT_TRUE(bench.step(i).has_pose());
  }
  ASSERT_FALSE(bench.step(5, true).has_pose());
  const auto carried = bench.stage.box_supply().carried;
  bench.step(6);
  EXPECT_EQ(bench.stage.box_supply().carried, carried);
  EXPECT_EQ(bench.stage.box_supply().none, 1u);
}

TEST(TrackStage, BoxesGrowOldAndGo) {
  TrackStageBench bench;
  bench.stage.take_boxes(TrackStageBench::boxes(0));
  for (int i = 0; i < 40; ++i) ASSERT_TRUE(bench.step(i).has_pose());
  EXPECT_EQ(bench.stage.box_supply().fresh, 1u);
  EXPECT_LE(bench.stage.box_supply().carried, 21u);  // detector.max_age_ms is 700
  EXPECT_GE(bench.stage.box_supply().none, 18u);
}

}  // namespace
}  // namespace stillmap
