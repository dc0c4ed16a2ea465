// SPDX-License-Identifier: Apache-2.0
#include "runtime/map_stage.h"

#include <gtest/gtest.h>

#include <utility>

#include "segment/segment.h"
#include "tests/runtime/wall_scene.h"

namespace stillmap {
namespace {

using test::WallScene;

constexpr std::size_t kFrames = 6;

struct MapStageBench {
  explicit MapStageBench(bool has_detector, Config c = WallScene::config())
      : config(std::move(c)),
        arena(64 << 20),
        pool(arena, kFrames, WallScene::kWidth, WallScene::kHeight),
        rays(arena, config.camera),
        stage(arena, config, rays, has_detector) {}

  FrameHandle frame(int index) {
    FrameHandle frame = pool.acquire();
    scene.draw(index, frame.writable());
    frame.writable().sequence = static_cast<std::uint64_t>(index);
    return frame;
  }
  Detections boxes(const FrameSlot& frame) const {
    Detections boxes{frame.sequence, frame.colour_ns, {}};
    EXPECT_TRUE(boxes.items.try_push_back(
        {WallScene::thing(static_cast<int>(frame.sequence)), 0, ClassKind::Dynamic, score, 1}));
    return boxes;
  }
  void take_frame(const FrameHandle& frame, bool own_boxes) {
    PosedFrame posed;
    posed.frame = frame.share();
    posed.sequence = frame->sequence;
    posed.stamp_ns = frame->colour_ns;
    posed.T_map_colour = posed.T_map_depth = WallScene::T_first_camera(static_cast<int>(frame->sequence));
    posed.T_map_colour = posed.T_map_depth = T_now_first * posed.T_map_colour;
    posed.T_map_keyframe = T_now_first;
    posed.epoch = epoch;
    posed.boxes_are_its_own = own_boxes;
    const Detections mask_of = own_boxes ? boxes(*frame) : Detections{};
    segment(mask_of, frame->depth, config.camera, config.track.dynamic_rule, posed.mask);
    stage.take_frame(std::move(posed));
  }
  /// The tracker learns that its keyframe is 32 cm farther on.
  void correct() {
    T_now_first.t.z += 0.32;
    Correction* correction = stage.corrections().room();
    ASSERT_NE(correction, nullptr);
    correction->epoch = ++epoch;
    correction->keyframes.clear();
    ASSERT_TRUE(correction->keyframes.try_push_back({0, T_now_first}));
    stage.corrections().post();
  }
  Occupancy wall(double moved_m) const { return stage.map().at({0.27, -0.53, 2.01 + moved_m}); }
  void take_detected(FrameHandle frame) {
    DetectedFrame detected;
    detected.boxes = boxes(*frame);
    detected.frame = std::move(frame);
    stage.take_detected(std::move(detected));
  }
  void expect_every_frame_free() {
    std::vector<FrameHandle> all;
    for (std::size_t i = 0; i < kFrames; ++i) all.push_back(pool.acquire());
    for (const FrameHandle& handle : all) EXPECT_TRUE(handle);
  }

  WallScene scene;
  Config config;
  Arena arena;
  FramePool pool;
  RayTable rays;
  MapStage stage;
  Pose T_now_first;  ///< the world of this epoch's poses in that of the first's
  std::uint32_t epoch = 0;
  float score = 0.9f;  ///< of the thing's box
};

/// The middle of the thing's front, in the map.
Vec3 thing_in_map(int index) {
  const Box b = WallScene::thing(index);
  const double x = (b.x0 + b.x1) / 2.0, y = (b.y0 + b.y1) / 2.0;
  return WallScene::T_first_camera(index) *
         Vec3{(x - 159.5) / WallScene::kFocal_px, (y - 119.5) / WallScene::kFocal_px, WallScene::kThing_m};
}

TEST(MapStage, WithoutADetectorEveryNthFrameIsFused) {
  MapStageBench bench(false);
  for (int i = 0; i < 20; ++i) bench.take_frame(bench.frame(i), false);
  EXPECT_EQ(bench.stage.map().fused_frames(), 10u);  // map.fuse_every is 2
  EXPECT_EQ(bench.stage.counts().carried_boxes, 10u);
  EXPECT_EQ(bench.stage.counts().own_boxes, 0u);
  EXPECT_EQ(bench.stage.fuse_time().count(), 10u);
  EXPECT_EQ(bench.stage.fuse_cpu_time().count(), 10u);
  EXPECT_EQ(bench.stage.map().at(thing_in_map(18)), Occupancy::Occupied);  // nothing says that it moves
  bench.expect_every_frame_free();
}

TEST(MapStage, FramesWithTheirOwnBoxesAreFusedAtOnceWithoutTheMover) {
  MapStageBench bench(true);
  for (int i = 0; i < 8; ++i) bench.take_frame(bench.frame(i), true);
  EXPECT_EQ(bench.stage.counts().own_boxes, 4u);
  EXPECT_EQ(bench.stage.counts().carried_boxes, 0u);
  EXPECT_GT(bench.stage.map().occupied_voxels(), 100u);
  EXPECT_NE(bench.stage.map().at(thing_in_map(6)), Occupancy::Occupied);
}

TEST(MapStage, AWeakBoxKeepsAThingOutWhereItWasSurelyFoundLately) {
  for (const bool with_frame : {true, false}) {
    for (const float first_score : {0.4f, 0.9f}) {
      MapStageBench bench(true);
      bench.score = first_score;
      for (int i = 0; i < 8; ++i) {
        const FrameHandle frame = bench.frame(i);
        bench.take_frame(frame, with_frame);
        if (!with_frame) bench.take_detected(frame.share());
        bench.score = 0.4f;
      }
      EXPECT_EQ(bench.stage.counts().own_boxes, 4u);
      EXPECT_EQ(bench.stage.map().at(thing_in_map(6)) == Occupancy::Occupied, first_score < 0.5f);
    }
  }
}

/// A thing that was surely found once, and then with `score` until the sixth fused frame, and stands still.
bool mapped_after_three_looks(float score) {
  MapStageBench bench(true);
  for (int i = 0; i <= 14; i += 2) {  // map.fuse_every is 2
    PosedFrame posed;
    posed.frame = bench.frame(0);
    posed.frame.writable().sequence = posed.sequence = static_cast<std::uint64_t>(i);
    posed.stamp_ns = WallScene::stamp_ns(i);
    posed.boxes_are_its_own = true;
    bench.score = i == 0 ? 0.9f : score;
    Detections boxes = bench.boxes(*bench.frame(0));
    boxes.stamp_ns = posed.stamp_ns;
    if (i > 8) boxes.items.clear();
    segment(boxes, posed.frame->depth, bench.config.camera, DynamicRule::Silhouette, posed.mask);
    bench.stage.take_frame(std::move(posed));
  }
  EXPECT_EQ(bench.stage.counts().own_boxes, 8u);
  return bench.stage.map().at(thing_in_map(0)) == Occupancy::Occupied;
}

TEST(MapStage, WhatWasWeaklyFoundIsMappedAfterThreeLooks) {
  EXPECT_TRUE(mapped_after_three_looks(0.4f));
  EXPECT_FALSE(mapped_after_three_looks(0.9f));
}

TEST(MapStage, ThePapersRuleTakesEveryBox) {
  Config config = WallScene::config();
  config.track.dynamic_rule = DynamicRule::Paper;
  for (const bool with_frame : {true, false}) {
    MapStageBench bench(true, config);
    bench.score = 0.4f;
    for (int i = 0; i < 8; ++i) {
      const FrameHandle frame = bench.frame(i);
      bench.take_frame(frame, with_frame);
      if (!with_frame) bench.take_detected(frame.share());
    }
    EXPECT_NE(bench.stage.map().at(thing_in_map(6)), Occupancy::Occupied);
  }
}

TEST(MapStage, AFrameWaitsForTheDetectorsWordOnIt) {
  MapStageBench bench(true);
  const FrameHandle first = bench.frame(0);
  bench.take_frame(first, false);
  bench.take_frame(bench.frame(1), false);
  EXPECT_EQ(bench.stage.map().fused_frames(), 0u);
  bench.take_detected(first.share());
  EXPECT_EQ(bench.stage.counts().own_boxes, 1u);
  EXPECT_EQ(bench.stage.counts().carried_boxes, 0u);
  EXPECT_NE(bench.stage.map().at(thing_in_map(0)), Occupancy::Occupied);
}

TEST(MapStage, ASilentDetectorIsNotWaitedFor) {
  MapStageBench bench(true);  // detector.max_age_ms is 700, 21 frames
  int index = 0;
  for (; index < 21; ++index) bench.take_frame(bench.frame(index), false);
  EXPECT_EQ(bench.stage.map().fused_frames(), 0u);
  for (; index < 31; ++index) bench.take_frame(bench.frame(index), false);
  EXPECT_GE(bench.stage.counts().carried_boxes, 4u);
  // It speaks again: its frames are waited for again.
  const FrameHandle again = bench.frame(index++);
  bench.take_frame(again, false);
  bench.take_detected(again.share());
  const auto before = bench.stage.counts();
  for (int end = index + 15; index < end; ++index) bench.take_frame(bench.frame(index), false);
  EXPECT_EQ(bench.stage.counts().carried_boxes, before.carried_boxes);
}

TEST(MapStage, BoxesThatComeWithTheirFrameAreNoSilence) {
  MapStageBench bench(true);
  for (int i = 0; i < 90; ++i) bench.take_frame(bench.frame(i), i % 15 == 0);
  EXPECT_EQ(bench.stage.counts().own_boxes, 6u);
  EXPECT_EQ(bench.stage.counts().carried_boxes, 0u);
}

TEST(MapStage, ADetectedFrameWithoutAPoseIsCountedAndLetGo) {
  MapStageBench bench(true);
  bench.take_frame(bench.frame(3), false);
  bench.take_detected(bench.frame(2));
  bench.take_detected(bench.frame(3 + 64));  // the same place in the list of recent poses
  EXPECT_EQ(bench.stage.counts().unposed, 2u);
  EXPECT_EQ(bench.stage.map().fused_frames(), 0u);
  bench.expect_every_frame_free();
}

TEST(MapStage, AnOlderFrameThanTheLastFusedIsLeftOut) {
  MapStageBench bench(true);
  const FrameHandle old = bench.frame(4), newer = bench.frame(9);
  bench.take_frame(old, false);
  bench.take_frame(newer, false);
  bench.take_detected(newer.share());
  bench.take_detected(old.share());
  EXPECT_EQ(bench.stage.map().fused_frames(), 1u);
}

TEST(MapStage, ACorrectionIsTakenWithTheFirstFrameOfItsEpoch) {
  MapStageBench bench(false);
  int index = 0;
  for (; index < 6; ++index) bench.take_frame(bench.frame(index), false);
  ASSERT_EQ(bench.wall(0), Occupancy::Occupied);
  bench.correct();
  const Pose T_corrected = std::exchange(bench.T_now_first, Pose{});
  bench.epoch = 0;  // this one was on its way
  bench.take_frame(bench.frame(index++), false);
  EXPECT_EQ(bench.stage.map().epoch(), 0u);
  EXPECT_EQ(bench.stage.corrections().room(), nullptr);

  bench.T_now_first = T_corrected;
  bench.epoch = 1;
  bench.take_frame(bench.frame(index++), false);
  EXPECT_EQ(bench.stage.map().epoch(), 1u);
  EXPECT_NE(bench.stage.corrections().room(), nullptr);
  EXPECT_TRUE(bench.stage.map().correcting());
  for (int i = 0; i < 40; ++i) bench.take_frame(bench.frame(index++), false);
  EXPECT_FALSE(bench.stage.map().correcting()) << "each frame does a slice";
  EXPECT_EQ(bench.wall(0.32), Occupancy::Occupied);
  EXPECT_NE(bench.wall(0), Occupancy::Occupied);
}

TEST(MapStage, ADetectedFrameOfAnOlderEpochIsBroughtToTheNewest) {
  MapStageBench bench(true);
  const FrameHandle first = bench.frame(0), old = bench.frame(1);
  bench.take_frame(first, false);
  bench.take_detected(first.share());
  bench.take_frame(old, false);
  bench.correct();
  bench.take_frame(bench.frame(5), false);
  bench.stage.finish_correction();
  ASSERT_EQ(bench.stage.map().epoch(), 1u);
  const Pose* keyframe = bench.stage.map().keyframe(0);
  ASSERT_NE(keyframe, nullptr);
  EXPECT_NEAR(keyframe->t.z, 0.32, 1e-9);
  const FrameHandle later = bench.frame(2);
  bench.take_frame(later, false);
  bench.take_detected(later.share());  // of this epoch
  for (int i = 0; i < 3; ++i) {
    const FrameHandle another = bench.frame(4 + 2 * i);
    bench.T_now_first.t.z -= 0.32;
    bench.epoch = 0;
    bench.take_frame(another, false);
    bench.T_now_first.t.z += 0.32;
    bench.epoch = 1;
    bench.take_detected(another.share());
  }
  EXPECT_EQ(bench.stage.counts().own_boxes, 5u);
  EXPECT_EQ(bench.wall(0.32), Occupancy::Occupied);
  EXPECT_NE(bench.wall(0), Occupancy::Occupied);
}

TEST(MapStage, ACorrectionThatFindsNoRoomIsMadeGoodByTheNext) {
  MapStageBench bench(false);
  int index = 0;
  for (; index < 6; ++index) bench.take_frame(bench.frame(index), false);
  bench.correct();
  // The tracker is two epochs on before the map has looked.
  bench.T_now_first.t.z += 0.32;
  bench.epoch = 2;
  ASSERT_EQ(bench.stage.corrections().room(), nullptr);
  bench.take_frame(bench.frame(index++), false);
  EXPECT_EQ(bench.stage.map().epoch(), 1u);
  bench.T_now_first.t.z -= 0.32;
  bench.epoch = 1;
  bench.correct();
  ASSERT_EQ(bench.epoch, 2u);
  for (int i = 0; i < 40; ++i) bench.take_frame(bench.frame(index++), false);
  EXPECT_EQ(bench.stage.map().epoch(), 2u);
  EXPECT_EQ(bench.wall(0.64), Occupancy::Occupied);
  EXPECT_NE(bench.wall(0.32), Occupancy::Occupied);
  EXPECT_NE(bench.wall(0), Occupancy::Occupied);
}

}  // namespace
}  // namespace stillmap
