// SPDX-License-Identifier: Apache-2.0
#include "map/mover_trail.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "tests/map/map_scene.h"

namespace stillmap {
namespace {

using test::MapUnderTest;
using test::Picture;
using test::small_camera;

struct TrailBench {
  TrailBench() { person.mask = silhouette(); }

  static DynamicMask silhouette() {
    DynamicMask mask;
    mask.rule = DynamicRule::Silhouette;
    mask.columns = 20;
    mask.rows = 15;
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
    trail.add_frame({person.depth.data(), c.width, c.height, c.width}, mask, T_map_camera, 4.5);
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
  EXPECT_FALSE(b.trail.near(in_mover));
  b.add(TrailBench::mover_in_columns(8, 11));
  EXPECT_TRUE(b.trail.near(in_mover));
  EXPECT_TRUE(b.trail.near(beside));
  EXPECT_TRUE(b.trail.near(before));
  EXPECT_FALSE(b.trail.near(away));
  EXPECT_FALSE(b.trail.near(right));
  for (std::uint32_t i = 0; i < MoverTrail::kFrames; ++i) {
    EXPECT_TRUE(b.trail.near(in_mover)) << i;
    b.add(TrailBench::silhouette());
  }
  EXPECT_TRUE(b.trail.near(in_mover));
  b.add(TrailBench::silhouette());
  EXPECT_FALSE(b.trail.near(in_mover));
}

TEST(MoverTrail, OnlyReadingsOfTheMoverCount) {
  TrailBench b;
  DynamicMask other_depth = TrailBench::mover_in_columns(8, 11);
  for (DynamicMask::Cell& cell : other_depth.cells) cell.near_mm = cell.far_mm = 1000;
  b.add(other_depth);
  EXPECT_FALSE(b.trail.near(b.T_map_camera * Vec3{0, 0, 1.5})) << "the reading is behind the mover";
  DynamicMask chair = TrailBench::mover_in_columns(8, 11);
  for (DynamicMask::Cell& cell : chair.cells) cell.label = Label::SemiStatic;
  b.add(chair);
  EXPECT_FALSE(b.trail.near(b.T_map_camera * Vec3{0, 0, 1.5}));
  DynamicMask paper = TrailBench::mover_in_columns(8, 11);
  paper.rule = DynamicRule::Paper;
  b.add(paper);
  EXPECT_FALSE(b.trail.near(b.T_map_camera * Vec3{0, 0, 1.5}));
}

TEST(MoverTrail, AFullTableForgetsTheOldestFirst) {
  TrailBench b;
  // Views all around fill the table many times over; the newest is still whole.
  for (int i = 0; i < 400; ++i) {
    b.T_map_camera = {exp_so3({0, 0.1 * i, 0}), {static_cast<double>(i), 0, 0}};
    b.add(TrailBench::mover_in_columns(0, 20));
  }
  for (double x = -0.6; x <= 0.6; x += 0.1) EXPECT_TRUE(b.trail.near(b.T_map_camera * Vec3{x, 0, 1.5})) << x;
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

/// A wall that a mover was in reach of is mapped by the first look after the mover has gone on.
TEST(MoverTrail, WhatIsSeenBesideAMoverWaitsForOneLookMore) {
  TrailBench b;
  std::vector<std::uint64_t> occupied;
  for (std::uint32_t frame = 0; frame <= MoverTrail::kFrames + 1; ++frame) {
    b.person.mask = frame == 0 ? TrailBench::mover_in_columns(0, 20) : TrailBench::silhouette();
    ASSERT_EQ(b.scene.map().fuse(b.scene.input(b.person, {})), FuseOutcome::Fused);
    occupied.push_back(b.scene.map().occupied_voxels());
  }
  const std::uint64_t after = occupied.back();
  occupied.pop_back();
  EXPECT_THAT(occupied, testing::Each(testing::Lt(10u)));  // a full bucket of the trail forgets a place
  EXPECT_GT(after, 100u);
}

}  // namespace
}  // namespace stillmap
