// SPDX-License-Identifier: Apache-2.0
// A room mapped on a path that bends away from the truth, and the correction that puts its keyframes right.
#include "map/map_corrector.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <set>

#include "map/kept_blocks.h"
#include "map/voxel_map.h"
#include "map_scene.h"
#include "tests/support/heap_calls.h"

namespace stillmap {
namespace {

using test::MapUnderTest;
using test::Picture;
using test::room;
using test::turned;

constexpr int kFrames = 84, kFramesPerKeyframe = 3;  // 5 degrees each: a turn and a sixth

CameraModel camera() {
  CameraModel c = test::small_camera();
  c.width *= 2;
  c.height *= 2;
  c.fx *= 2;
  c.fy *= 2;
  c.cx *= 2;
  c.cy *= 2;
  return c;
}

Pose true_pose(int frame) {
  const double yaw = frame * 5 * M_PI / 180;
  return turned(yaw, {0.4 * std::sin(yaw), 0, 0.4 * std::cos(yaw)});
}
/// Off by 12 degrees and 30 cm after the whole turn.
Pose bent_pose(int frame) {
  const double share = frame / 72.0;
  return turned(share * 12 * M_PI / 180, share * Vec3{0.2, 0, -0.22}) * true_pose(frame);
}

/// How far voxels are from the room's walls, and what else matters of a map.
struct Quality {
  double mean_error_m = 0, share_beyond = 0;  // of two voxels
  std::uint64_t voxels = 0;
};

struct RoomTest : testing::Test {
  explicit RoomTest(int copies = 32) { config.keyframe_copies = copies; }
  int frames = kFrames;

  void map_room(MapUnderTest& t, bool bent, KeptBlocks* kept = nullptr) {
    for (int i = 0; i < frames; ++i) {
      Picture p = t.render(room(), true_pose(i));
      FuseInput input = t.input(p, bent ? bent_pose(i) : true_pose(i), static_cast<std::uint64_t>(i) + 1,
                                static_cast<std::uint32_t>(i / kFramesPerKeyframe));
      const int keyframe = i / kFramesPerKeyframe * kFramesPerKeyframe;
      input.T_map_keyframe = bent ? bent_pose(keyframe) : true_pose(keyframe);
      ASSERT_EQ(t.map().fuse(input), FuseOutcome::Fused);
      if (kept != nullptr) kept->take_all();
    }
  }
  static const Correction& the_truth(std::uint32_t epoch = 1, std::uint32_t every = 1) {
    static Correction correction;
    correction.epoch = epoch;
    correction.keyframes.clear();
    for (std::uint32_t id = 0; id < kFrames / kFramesPerKeyframe; id += every) {
      EXPECT_TRUE(
          correction.keyframes.try_push_back({id, true_pose(static_cast<int>(id) * kFramesPerKeyframe)}));
    }
    return correction;
  }
  /// The number of slices that it took.
  static int finish(VoxelMap& map) {
    int slices = 0;
    for (; map.correcting(); ++slices) map.continue_correction();
    return slices;
  }
  static Quality quality(const VoxelMap& map) {
    Quality q;
    map.for_each_occupied([&](const OccupiedVoxel& v) {
      const auto off = [](float place, double wall) {
        return std::abs(std::abs(static_cast<double>(place)) - wall);
      };
      const double error = std::min({off(v.x, 3), off(v.y, 2), off(v.z, 3)});
      q.mean_error_m += error;
      q.share_beyond += error > 2 * map.voxel_m();
      ++q.voxels;
    });
    q.mean_error_m /= static_cast<double>(q.voxels);
    q.share_beyond /= static_cast<double>(q.voxels);
    return q;
  }
  /// The share of the voxels of `truth` that have an occupied one of `map` where they or a neighbour are.
  static double recall(const VoxelMap& truth, const VoxelMap& map) {
    double found = 0, all = 0;
    const double edge = map.voxel_m();
    truth.for_each_occupied([&](const OccupiedVoxel& v) {
      bool near = false;
      for (int n = 0; n < 27 && !near; ++n) {
        near = map.at({v.x + edge * (n % 3 - 1), v.y + edge * (n / 3 % 3 - 1), v.z + edge * (n / 9 - 1)}) ==
               Occupancy::Occupied;
      }
      found += near;
      ++all;
    });
    return found / all;
  }
  static void expect_sound(const VoxelMap& map) {
    std::uint64_t occupied = 0;
    std::set<std::array<std::int32_t, 3>> places;
    for (int i = 0; i < map.blocks().size(); ++i) {
      const Block& block = map.blocks().block(i);
      const auto counted =
          std::ranges::count_if(map.blocks().voxels(i), [](const Voxel& v) { return v.occupied(); });
      EXPECT_EQ(counted, block.occupied);
      occupied += block.occupied;
      if (block.state == BlockState::Empty) continue;
      EXPECT_EQ(block.state, BlockState::Current);
      EXPECT_TRUE(map.blocks().found(i));
      EXPECT_TRUE(places.insert({block.at.x, block.at.y, block.at.z}).second);
    }
    EXPECT_EQ(occupied, map.occupied_voxels());
    EXPECT_EQ(places.size(), map.blocks().blocks_used());
  }

  Config::Map config;
};

TEST_F(RoomTest, ABentRoomBecomesStraight) {
  MapUnderTest truth(camera(), config), t(camera(), config);
  map_room(truth, false);
  map_room(t, true);
  const Quality before = quality(t.map()), straight = quality(truth.map());
  const double recall_before = recall(truth.map(), t.map());
  t.map().correct(the_truth());
  EXPECT_EQ(t.map().epoch(), 1u);
  EXPECT_TRUE(t.map().correcting());
  finish(t.map());
  const Quality after = quality(t.map());
  const double recall_after = recall(truth.map(), t.map());
  std::printf(
      "mean error %.4f -> %.4f m (straight %.4f), beyond two voxels %.3f -> %.3f (%.3f), recall %.3f -> "
      "%.3f, "
      "voxels %llu -> %llu (%llu)\n",
      before.mean_error_m, after.mean_error_m, straight.mean_error_m, before.share_beyond, after.share_beyond,
      straight.share_beyond, recall_before, recall_after, static_cast<unsigned long long>(before.voxels),
      static_cast<unsigned long long>(after.voxels), static_cast<unsigned long long>(straight.voxels));
  EXPECT_GT(before.mean_error_m, 0.1);
  EXPECT_LT(after.mean_error_m, 0.022);
  EXPECT_LT(after.share_beyond, 0.01);
  EXPECT_LT(recall_before, 0.6);
  EXPECT_GT(recall_after, 0.95);
  expect_sound(t.map());
}

struct WithoutCopies : RoomTest {
  WithoutCopies() : RoomTest(0) {}
};

TEST_F(WithoutCopies, BlocksMoveRigidlyWithTheirKeyframes) {
  MapUnderTest truth(camera(), config), t(camera(), config);
  map_room(truth, false);
  map_room(t, true);
  const Quality before = quality(t.map());
  t.map().correct(the_truth());
  finish(t.map());
  const Quality after = quality(t.map());
  std::printf("mean error %.4f -> %.4f m, recall %.3f -> %.3f\n", before.mean_error_m, after.mean_error_m,
              recall(truth.map(), t.map()), recall(truth.map(), t.map()));
  EXPECT_LT(after.mean_error_m, 0.4 * before.mean_error_m);
  EXPECT_GT(recall(truth.map(), t.map()), 0.85);
  expect_sound(t.map());
}

struct FewCopies : RoomTest {
  FewCopies() : RoomTest(6) {}
};

TEST_F(FewCopies, WhatTheCopiesDoNotShowMovesRigidly) {
  MapUnderTest truth(camera(), config), t(camera(), config);
  map_room(truth, false);
  map_room(t, true);
  t.map().correct(the_truth());
  finish(t.map());
  const Quality after = quality(t.map());
  EXPECT_LT(after.mean_error_m, 0.05);
  EXPECT_GT(recall(truth.map(), t.map()), 0.9);
  expect_sound(t.map());
}

TEST_F(RoomTest, KeyframesThatTheTrackerHasGivenUpMoveBetweenTheirNeighbours) {
  MapUnderTest truth(camera(), config), t(camera(), config);
  map_room(truth, false);
  map_room(t, true);
  t.map().correct(the_truth(1, 3));
  finish(t.map());
  EXPECT_LT(quality(t.map()).mean_error_m, 0.03);
  EXPECT_GT(recall(truth.map(), t.map()), 0.95);
}

TEST_F(RoomTest, EachSliceIsBoundedAndNothingComesFromTheHeap) {
  MapUnderTest t(camera(), config);
  map_room(t, true);
  const BlockTable& blocks = t.map().blocks();
  const Correction& correction = the_truth();
  const auto old = [&] {
    int count = 0;
    for (int i = 0; i < blocks.size(); ++i) count += blocks.block(i).state == BlockState::Old;
    return count;
  };
  const long heap = test::heap_calls();
  t.map().correct(correction);
  const int old_at_first = old();
  EXPECT_GT(old_at_first, 200);
  int slices = 0;
  for (int before = old_at_first; t.map().correcting(); ++slices) {
    t.map().continue_correction();
    const int now = old();
    EXPECT_LE(before - now, MapCorrector::kMovedAtOnce);
    before = now;
  }
  EXPECT_EQ(test::heap_calls(), heap);
  EXPECT_EQ(old(), 0);
  constexpr int kCopies = kFrames / kFramesPerKeyframe;
  EXPECT_LE(slices,
            kCopies / MapCorrector::kTouchedAtOnce + kCopies + old_at_first / MapCorrector::kMovedAtOnce + 4);
}

TEST_F(RoomTest, UntilItsTurnAnOldBlockShowsWhereItWas) {
  MapUnderTest t(camera(), config);
  map_room(t, true);
  const Quality before = quality(t.map());
  t.map().correct(the_truth());
  EXPECT_EQ(quality(t.map()).voxels, before.voxels);
  EXPECT_EQ(t.map().at(bent_pose(0) * Vec3{0, 0, 2.59}), Occupancy::Occupied);
  while (t.map().correcting()) {
    EXPECT_EQ(t.map().settled_epoch(), 0u) << "some of it is still where it was";
    t.map().continue_correction();
  }
  EXPECT_EQ(t.map().settled_epoch(), 1u);
}

TEST_F(RoomTest, ASecondCorrectionInTheMiddleOfTheFirstEndsRight) {
  MapUnderTest truth(camera(), config), t(camera(), config);
  map_room(truth, false);
  map_room(t, true);
  static Correction halfway;
  halfway.epoch = 1;
  halfway.keyframes.clear();
  for (const Correction::KeyframePose& k : the_truth().keyframes) {
    const Pose bent = bent_pose(static_cast<int>(k.id) * kFramesPerKeyframe);
    ASSERT_TRUE(halfway.keyframes.try_push_back({k.id, interpolate(bent, k.T_map_camera, 0.5)}));
  }
  t.map().correct(halfway);
  for (int i = 0; i < 34; ++i) t.map().continue_correction();  // some blocks have moved, some wait
  ASSERT_TRUE(t.map().correcting());
  t.map().correct(the_truth(2));
  EXPECT_EQ(t.map().settled_epoch(), 0u) << "the first was never done";
  finish(t.map());
  EXPECT_EQ(t.map().epoch(), 2u);
  EXPECT_EQ(t.map().settled_epoch(), 2u);
  EXPECT_LT(quality(t.map()).mean_error_m, 0.04);
  EXPECT_GT(recall(truth.map(), t.map()), 0.93);
  expect_sound(t.map());
}

TEST_F(RoomTest, StepsTooSmallToSeeAreTakenTogether) {
  MapUnderTest t(camera(), config);
  map_room(t, false);
  const std::string before = test::bytes_of(t.map());
  static Correction creep;
  for (std::uint32_t epoch = 1; epoch <= 3; ++epoch) {
    creep.epoch = epoch;
    creep.keyframes.clear();
    for (Correction::KeyframePose k : the_truth().keyframes) {
      k.T_map_camera.t.x += 0.009 * epoch;  // a voxel is 4 cm
      ASSERT_TRUE(creep.keyframes.try_push_back(k));
    }
    t.map().correct(creep);
    EXPECT_EQ(t.map().correcting(), epoch == 3);
    EXPECT_EQ(t.map().settled_epoch(), std::min(epoch, 2u)) << "what is not worth moving is followed";
    if (epoch < 3) {
      EXPECT_EQ(test::bytes_of(t.map()), before);
    }
  }
  EXPECT_NEAR(t.map().keyframe(5)->t.x, true_pose(5 * kFramesPerKeyframe).t.x + 0.027, 1e-9);
}

TEST_F(RoomTest, AFullTableStaysWithinItsBlocks) {
  config.capacity_voxels = 420 * kBlockVoxels;
  MapUnderTest t(camera(), config);
  map_room(t, true);
  ASSERT_GT(t.map().blocks_evicted(), 0u);
  t.map().correct(the_truth());
  finish(t.map());
  EXPECT_LE(t.map().blocks().blocks_used(), 420u);
  EXPECT_LT(quality(t.map()).mean_error_m, 0.04);
  expect_sound(t.map());
}

TEST_F(RoomTest, WhatATableTooSmallGaveAwayIsCorrectedAndSavedWithTheRest) {
  config.keyframe_copies = 0;  // all moves with its keyframe
  frames = 54;                 // no place is seen from two ends
  MapUnderTest large(camera(), config);
  map_room(large, true);
  config.capacity_voxels = 420 * kBlockVoxels;
  Arena arena(8 << 20);
  KeptBlocks kept(arena, 4000, config.voxel_m);
  ASSERT_TRUE(kept.open(testing::TempDir() + "kept").ok());
  MapUnderTest t(camera(), config, kept.lane());
  map_room(t, true, &kept);
  const auto found = [&] {
    const std::string file = testing::TempDir() + "kept.stillmap";
    MapFileWriter writer(file, {config.voxel_m, 0, false});
    append_blocks(t.map().blocks(), writer);
    kept.append_to(writer);
    EXPECT_TRUE(writer.finish().ok());
    Result<MapFile> read = read_map_file(file);
    EXPECT_TRUE(read.ok());
    MapUnderTest whole(camera(), {});
    EXPECT_TRUE(whole.map().load(*read.value().blocks).empty());
    EXPECT_GT(recall(whole.map(), large.map()), 0.999) << "nothing else is in it";
    return recall(large.map(), whole.map());
  };
  const double before = found(), in_memory = recall(large.map(), t.map());

  large.map().correct(the_truth());
  finish(large.map());
  ASSERT_TRUE(t.map().can_correct());
  t.map().correct(the_truth());
  EXPECT_FALSE(t.map().can_correct());
  for (int i = 0; i < 100; ++i) t.map().continue_correction();
  constexpr std::size_t kOfASlice = 420 / 16 + MapCorrector::kMovedAtOnce;
  EXPECT_LE(kept.lane()->blocks.size(), kOfASlice) << "it waits until there is room for what gives way";
  for (kept.take_all(); t.map().correcting(); kept.take_all()) t.map().continue_correction();
  EXPECT_TRUE(t.map().can_correct());
  expect_sound(t.map());
  const double after = found();
  std::printf(
      "[ MEASURED ] 420 blocks of %zu in memory, with %.1f %% of the voxels; in the file %.2f %%, corrected "
      "%.2f %%\n",
      large.map().blocks().blocks_used(), 100 * in_memory, 100 * before, 100 * after);
  EXPECT_GT(after, before - 0.001);
  EXPECT_GT(before, 0.97);  // the others were too far off to get a place
  EXPECT_LT(in_memory, 0.6);
  EXPECT_EQ(kept.usage().refused + kept.lane()->blocks.usage("").refused, 0u);
}

TEST(KeyframePoses, AKeyframeThatIsNotNamedMovesBetweenItsNeighbours) {
  Arena arena(8 << 20);
  KeyframePoses poses(arena);
  for (std::uint32_t id = 10; id <= 20; ++id) poses.learn(id, {});
  poses.learn(10, turned(1));  // known already
  static Correction correction;
  ASSERT_TRUE(correction.keyframes.try_push_back({20, {{}, {1, 0, 0}}}));
  ASSERT_TRUE(correction.keyframes.try_push_back({10, {}}));
  ASSERT_TRUE(correction.keyframes.try_push_back({77, {{}, {9, 9, 9}}}));  // never mapped under
  ASSERT_TRUE(poses.correct(correction, 0.02));
  EXPECT_FALSE(poses.motion_of(10));
  EXPECT_FALSE(poses.motion_of(3));
  EXPECT_NEAR(poses.motion_of(15)->t.x, 0.5, 1e-12);
  EXPECT_NEAR(poses.find(15)->t.x, 0.5, 1e-12);
  EXPECT_NEAR(poses.motion_of(500)->t.x, 1, 1e-12);
  EXPECT_EQ(poses.find(77), nullptr);
  correction.keyframes.clear();
  EXPECT_FALSE(poses.correct(correction, 0.02));
  EXPECT_FALSE(poses.motion_of(15));
}

TEST(KeyframePoses, ASegmentMovesWithoutTheOneBefore) {
  Arena arena(8 << 20);
  KeyframePoses poses(arena);
  for (std::uint32_t id = 10; id <= 20; ++id) poses.learn(id, {});
  static Correction correction;
  correction.segment_begin = 16;
  ASSERT_TRUE(correction.keyframes.try_push_back({10, {}}));
  ASSERT_TRUE(correction.keyframes.try_push_back({18, {{}, {3, 0, 0}}}));
  ASSERT_TRUE(poses.correct(correction, 0.02));
  EXPECT_FALSE(poses.motion_of(15)) << "the last of the first segment";
  EXPECT_NEAR(poses.motion_of(16)->t.x, 3, 1e-12);
  EXPECT_NEAR(poses.find(17)->t.x, 3, 1e-12);
  correction.keyframes.clear();
  ASSERT_TRUE(correction.keyframes.try_push_back({18, {{}, {4, 0, 0}}}));
  ASSERT_TRUE(poses.correct(correction, 0.02));
  EXPECT_NEAR(poses.motion_of(10)->t.x, 1, 1e-12) << "with the nearest that there is";
}

TEST(KeyframeCopies, TheCopyWhoseViewAnotherRepeatsGivesWay) {
  const CameraModel c = camera();
  Arena arena(8 << 20);
  KeyframeCopies copies(arena, c, 3);
  EXPECT_EQ(copies.camera().width, 80);
  std::vector<float> z(static_cast<std::size_t>(c.width * c.height), -1.25f);
  z[static_cast<std::size_t>(6 * c.width + 10)] = 2.5f;  // the pixel that stands for the square at (2, 1)
  std::vector<Bgr> colour(z.size(), {1, 2, 3});
  const auto add = [&](std::uint32_t id, const Pose& T) {
    copies.add(id, T, T, z, {colour.data(), c.width, c.height, c.width});
  };
  add(1, turned(0));
  add(2, turned(1));
  add(3, turned(1.01));
  add(4, turned(2));
  EXPECT_TRUE(copies.has(1) && copies.has(3) && copies.has(4));
  EXPECT_FALSE(copies.has(2));
  EXPECT_EQ(copies.copies()[0].z_mm[80 + 2], 2500);
  EXPECT_EQ(copies.copies()[0].z_mm[80 + 3], -1250);
  EXPECT_EQ(copies.usage().refused, 1u);
}

}  // namespace
}  // namespace stillmap
