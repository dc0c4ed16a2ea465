// SPDX-License-Identifier: Apache-2.0
#include "map/mover_trail.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "tests/map/map_scene.h"

namespace stillmap {
namespace {

using Nearness = MoverTrail::Nearness;
using test::MapUnderTest;
using test::Picture;
using test::small_camera;

constexpr float kSureScore = 0.5f;

struct TrailBench {
  TrailBench() { person.mask = silhouette(); }

  static DynamicMask silhouette() {
    DynamicMask mask;
    mask.rule = DynamicRule::Silhouette;
    mask.columns = 20;
    mask.rows = 15;
    Detection mover;
    mover.kind = ClassKind::Dynamic;
    mover.score = kSureScore;
    EXPECT_TRUE(mask.boxes.items.try_push_back(mover));
    return mask;
  }
  /// What stands at 1.5 m in the columns [x0, x1) is a mover.
  static DynamicMask mover_in_columns(int x0, int x1) {
    DynamicMask mask = silhouette();
    for (int row = 0; row < mask.rows; ++row) {
      for (int column = x0; column < x1; ++column)
        mask.cells[static_cast<std::size_t>(row * mask.columns + column)] = {1400, 1600, Label::Dynamic, 0};
    }
    return mask;
  }
  void add(const DynamicMask& mask) {
    const CameraModel& c = scene.camera();
    trail.add_frame({person.depth.data(), c.width, c.height, c.width}, mask, kSureScore, T_map_camera, 4.5);
  }

  MapUnderTest scene{small_camera()};
  Arena arena{1 << 20};
  MoverTrail trail{arena, scene.camera(), scene.rays()};
  Pose T_map_camera{exp_so3({0, 0.3, 0}), {1, 2, 3}};
  Picture person = scene.render(
      [](Vec3 o, Vec3 d) {
        return std::optional<test::Hit>({1.5 + 0 * (o.x + d.x), {}});
      },
      {});
};

TEST(MoverTrail, RemembersWhereAMoverWasForAFewFrames) {
  TrailBench b;
  const Vec3 in_mover = b.T_map_camera * Vec3{0, 0, 1.5}, beside = b.T_map_camera * Vec3{0.1, 0, 1.55},
             before = b.T_map_camera * Vec3{0, 0, 1.42}, away = b.T_map_camera * Vec3{0, 0, 1.8},
             right = b.T_map_camera * Vec3{0.7, 0, 1.5};
  EXPECT_EQ(b.trail.near(in_mover), Nearness::None);
  b.add(TrailBench::mover_in_columns(8, 11));
  EXPECT_EQ(b.trail.near(in_mover), Nearness::Sure);
  EXPECT_EQ(b.trail.near(beside), Nearness::Sure);
  EXPECT_EQ(b.trail.near(before), Nearness::Sure);
  EXPECT_EQ(b.trail.near(away), Nearness::None);
  EXPECT_EQ(b.trail.near(right), Nearness::None);
  for (std::uint32_t i = 0; i < MoverTrail::kFrames; ++i) {
    EXPECT_EQ(b.trail.near(in_mover), Nearness::Sure) << i;
    b.add(TrailBench::silhouette());
  }
  EXPECT_EQ(b.trail.near(in_mover), Nearness::Sure);
  b.add(TrailBench::silhouette());
  EXPECT_EQ(b.trail.near(in_mover), Nearness::None);
}

TEST(MoverTrail, OnlyReadingsOfTheMoverCount) {
  TrailBench b;
  DynamicMask other_depth = TrailBench::mover_in_columns(8, 11);
  for (DynamicMask::Cell& cell : other_depth.cells) cell.near_mm = cell.far_mm = 1000;
  b.add(other_depth);
  EXPECT_EQ(b.trail.near(b.T_map_camera * Vec3{0, 0, 1.5}), Nearness::None)
      << "the reading is behind the mover";
  DynamicMask chair = TrailBench::mover_in_columns(8, 11);
  for (DynamicMask::Cell& cell : chair.cells) cell.label = Label::SemiStatic;
  b.add(chair);
  EXPECT_EQ(b.trail.near(b.T_map_camera * Vec3{0, 0, 1.5}), Nearness::None);
  DynamicMask paper = TrailBench::mover_in_columns(8, 11);
  paper.rule = DynamicRule::Paper;
  b.add(paper);
  EXPECT_EQ(b.trail.near(b.T_map_camera * Vec3{0, 0, 1.5}), Nearness::None);
}

TEST(MoverTrail, AMoverOfWhichTheDetectorIsNotSureIsToldApart) {
  TrailBench b;
  const Vec3 p_map = b.T_map_camera * Vec3{0, 0, 1.5};
  DynamicMask unsure = TrailBench::mover_in_columns(8, 11), sure = unsure;
  unsure.boxes.items[0].score = kSureScore - 0.01f;
  b.add(unsure);
  EXPECT_EQ(b.trail.near(p_map), Nearness::Unsure);
  b.add(sure);
  for (std::uint32_t i = 0; i < MoverTrail::kFrames; ++i) b.add(unsure);
  EXPECT_EQ(b.trail.near(p_map), Nearness::Sure) << "what is sure is not forgotten over what is not";
  b.add(unsure);
  EXPECT_EQ(b.trail.near(p_map), Nearness::Unsure);
}

TEST(MoverTrail, AFullTableForgetsTheOldestFirst) {
  TrailBench b;
  // Views all around fill the table many times over; the newest is still whole.
  for (int i = 0; i < 400; ++i) {
    b.T_map_camera = {exp_so3({0, 0.1 * i, 0}), {static_cast<double>(i), 0, 0}};
    b.add(TrailBench::mover_in_columns(0, 20));
  }
  for (double x = -0.6; x <= 0.6; x += 0.1)
    EXPECT_EQ(b.trail.near(b.T_map_camera * Vec3{x, 0, 1.5}), Nearness::Sure) << x;
}

/// A person that a detector sees in one fused frame of three walks before a wall.
TEST(MoverTrail, APersonMissedForTwoFramesLeavesNothingInTheMap) {
  const auto occupied_before_wall = [](int seen_every) {
    MapUnderTest t(small_camera());
    for (int frame = 0; frame < 12; ++frame) {
      const double left_m = -0.7 + 0.06 * frame;
      Picture p = t.render(
          [&](Vec3 o, Vec3 d) {
            const auto hit = test::meet_plane(o, d, {0, 0, 1}, 1.5, {});
            const double x = o.x + hit->t * d.x;
            return x > left_m && x < left_m + 0.4 ? hit : test::meet_plane(o, d, {0, 0, 1}, 3, {});
          },
          {});
      p.mask = frame % seen_every == 0 ? TrailBench::mover_in_columns(0, 20) : TrailBench::silhouette();
      EXPECT_EQ(t.map().fuse(t.input(p, {})), FuseOutcome::Fused);
    }
    int n = 0;
    t.map().for_each_occupied([&](const OccupiedVoxel& v) { n += v.z < 2.8f; });
    return n;
  };
  EXPECT_EQ(occupied_before_wall(3), 0);
  EXPECT_GT(occupied_before_wall(100), 100) << "the scene is no test";
}

/// Occupied voxels after each fused frame of a wall that a mover was in reach of when the first came.
std::vector<std::uint64_t> occupied_beside_mover(float score) {
  TrailBench b;
  std::vector<std::uint64_t> occupied;
  for (std::uint32_t frame = 0; frame <= MoverTrail::kFrames + 1; ++frame) {
    b.person.mask = frame == 0 ? TrailBench::mover_in_columns(0, 20) : TrailBench::silhouette();
    b.person.mask.boxes.items[0].score = score;
    FuseInput input = b.scene.input(b.person, {});
    input.sure_score = kSureScore;
    EXPECT_EQ(b.scene.map().fuse(input), FuseOutcome::Fused);
    occupied.push_back(b.scene.map().occupied_voxels());
  }
  return occupied;
}

constexpr std::uint64_t kFew = 10, kWall = 100;  // a full bucket of the trail forgets a place

TEST(MoverTrail, WhatIsSeenBesideASureMoverWaitsForOneLookMore) {
  std::vector<std::uint64_t> occupied = occupied_beside_mover(kSureScore);
  EXPECT_GT(occupied.back(), kWall);
  occupied.pop_back();
  EXPECT_THAT(occupied, testing::Each(testing::Lt(kFew)));
}

TEST(MoverTrail, WhatIsSeenBesideAnUnsureMoverTakesThreeLooks) {
  const std::vector<std::uint64_t> occupied = occupied_beside_mover(kSureScore - 0.01f);
  EXPECT_LT(occupied[2], kFew) << "the mover's frame and two looks";
  EXPECT_GT(occupied[3], kWall);
}

}  // namespace
}  // namespace stillmap
