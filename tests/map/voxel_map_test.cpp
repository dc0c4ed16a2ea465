// SPDX-License-Identifier: Apache-2.0
#include "map/voxel_map.h"

#include <gtest/gtest.h>

#include <limits>
#include <set>
#include <string>

#include "map_scene.h"

namespace stillmap {
namespace {

using test::bytes_of;
using test::Hit;
using test::MapUnderTest;
using test::meet_plane;
using test::Picture;
using test::room;
using test::Scene;
using test::small_camera;
using test::turned;
using test::wall;

constexpr Bgr kGrey{90, 90, 90};

/// A person-sized board, 0.6 m wide, at z = 1.5 m before what `behind` shows.
Scene board_before(const Scene& behind) {
  return [behind](Vec3 o, Vec3 d) -> std::optional<Hit> {
    const auto board = meet_plane(o, d, {0, 0, 1}, 1.5, {0, 0, 255});
    if (board && std::abs(o.x + board->t * d.x) < 0.3) return board;
    return behind(o, d);
  };
}

std::size_t occupied_within(const VoxelMap& map, double z0, double z1) {
  std::size_t n = 0;
  map.for_each_occupied([&](const OccupiedVoxel& v) { n += v.z >= z0 && v.z <= z1; });
  return n;
}

TEST(VoxelMap, a_wall_through_the_freiburg1_lens_comes_out_flat) {
  MapUnderTest t(small_camera(true));
  t.see(wall(2.02), {}, 3);
  ASSERT_GT(t.map().occupied_voxels(), 500u);
  t.map().for_each_occupied(
      [](const OccupiedVoxel& v) { ASSERT_NEAR(v.z, 2.02, 0.04) << v.x << " " << v.y; });
  // And it is as wide as the lens sees it: the ray of the last column.
  float right = 0;
  t.map().for_each_occupied([&](const OccupiedVoxel& v) { right = std::max(right, v.x); });
  EXPECT_NEAR(right, 2.02 * t.camera().undistort({158, 60}).x, 0.05);
}

TEST(VoxelMap, knows_occupied_free_and_unknown) {
  MapUnderTest t(small_camera());
  t.see(wall(2.02), {}, 3);
  EXPECT_EQ(t.map().at({0, 0, 2.02}), Occupancy::Occupied);
  EXPECT_EQ(t.map().at({0.3, 0.1, 1.94}), Occupancy::Free);
  EXPECT_EQ(t.map().at({0, 0, 2.14}), Occupancy::Unknown);
  EXPECT_EQ(t.map().at({0, 0, -2}), Occupancy::Unknown);
  for (const double wild : {1e12, -1e300, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_EQ(t.map().at({wild, 0, 0}), Occupancy::Unknown);
  }
}

TEST(VoxelMap, one_reading_alone_shows_nothing) {
  MapUnderTest t(small_camera());
  t.see(wall(2.02));
  EXPECT_EQ(t.map().occupied_voxels(), 0u);
  t.see(wall(2.02));
  EXPECT_GT(t.map().occupied_voxels(), 0u);
}

TEST(VoxelMap, what_is_seen_through_fades_within_a_second) {
  for (const double background_m :
       {3.0, 6.0}) {  // the second is beyond the map's range and still frees the ray
    MapUnderTest t(small_camera());
    t.see(board_before(wall(background_m)), {}, 200);
    ASSERT_GT(occupied_within(t.map(), 1.4, 1.6), 200u);
    t.see(wall(background_m), {}, 14);
    EXPECT_EQ(occupied_within(t.map(), 1.4, 1.6), 0u);
    EXPECT_EQ(t.map().at({0, 0, 1.5}), Occupancy::Free);
  }
}

TEST(VoxelMap, what_moves_leaves_nothing_and_hides_nothing_for_good) {
  for (const DynamicRule rule : {DynamicRule::Paper, DynamicRule::Silhouette}) {
    MapUnderTest t(small_camera());
    Picture with_person = t.render(board_before(wall(3)), {});
    with_person.mask.rule = rule;
    with_person.mask.columns = 20;
    with_person.mask.rows = 15;
    const float left = static_cast<float>(t.camera().project({-0.3, 0, 1.5}).x) - 1;
    const float right = static_cast<float>(t.camera().project({0.3, 0, 1.5}).x) + 1;
    ASSERT_TRUE(
        with_person.mask.boxes.items.try_push_back({{left, 0, right, 120}, 0, ClassKind::Dynamic, 1}));
    for (DynamicMask::Cell& cell : with_person.mask.cells) cell = {1400, 1600, Label::Dynamic, 0};
    // Something stood before the person before: the ray to the person frees it.
    t.see(wall(1.1), {}, 3);
    for (int i = 0; i < 20; ++i) ASSERT_EQ(t.map().fuse(t.input(with_person, {})), FuseOutcome::Fused);
    EXPECT_EQ(occupied_within(t.map(), 1.0, 2.8), 0u);
    EXPECT_EQ(t.map().at({0, 0, 1.1}), Occupancy::Free);
    EXPECT_EQ(t.map().at({0, 0, 3.02}), Occupancy::Unknown) << "nobody saw behind the person";
    EXPECT_EQ(t.map().at({1, 0, 3.02}), Occupancy::Occupied);
  }
}

TEST(VoxelMap, silhouettes_leave_no_bridge_between_near_and_far) {
  MapUnderTest t(small_camera());
  Picture p = t.render(board_before(wall(3)), {});
  // Sensors smear an edge: the pixels between board and wall read in between.
  for (int y = 0; y < 120; ++y) {
    for (int x = 1; x < 159; ++x) {
      const std::size_t i = static_cast<std::size_t>(y * 160 + x);
      if (p.depth[i - 1] == 7500 && p.depth[i] == 15000) p.depth[i] = 11000;
    }
  }
  for (int i = 0; i < 5; ++i) ASSERT_EQ(t.map().fuse(t.input(p, {})), FuseOutcome::Fused);
  EXPECT_EQ(occupied_within(t.map(), 1.6, 2.85), 0u);
}

TEST(VoxelMap, a_floor_at_a_grazing_angle_stays) {
  CameraModel camera = small_camera();
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 517;
  camera.cx = 320;
  camera.cy = 240;
  MapUnderTest t(camera);
  // Some 0.37 m above the floor, looking along it: at 2 m the rays meet it at 10 degrees, and the centre of a
  // voxel that it crosses is up to 0.12 m before it. The camera is at no round place in its own voxel.
  const Pose T_map_camera{{}, {0.013, -0.011, 0.027}};
  for (const double height_m : {0.365, 0.38, 0.395}) {
    t.see([=](Vec3 o, Vec3 d) { return meet_plane(o, d, {0, 1, 0}, height_m, kGrey); }, T_map_camera, 30);
    int missing = 0, thick = 0;
    for (double z = 1.22; z < 2.06; z += 0.04) {
      for (double x = -0.3; x < 0.3; x += 0.04) {
        missing += t.map().at({x, 0.37, z}) != Occupancy::Occupied;
        thick += t.map().at({x, 0.33, z}) == Occupancy::Occupied ||
                 t.map().at({x, 0.41, z}) == Occupancy::Occupied;
      }
    }
    EXPECT_EQ(missing, 0) << height_m;
    EXPECT_EQ(thick, 0) << height_m;
  }
}

TEST(VoxelMap, colours_are_those_of_the_walls) {
  MapUnderTest t(small_camera());
  t.see(room(), turned(0, {0, 0, 1}), 3);
  const auto near = [](const OccupiedVoxel& v, double at) {
    return std::abs(v.z - at) < 0.05 && std::abs(v.x) < 1;
  };
  int seen = 0;
  t.map().for_each_occupied([&](const OccupiedVoxel& v) {
    if (!near(v, 3)) return;
    ++seen;
    ASSERT_EQ(v.colour.b, 200);
    ASSERT_EQ(v.colour.g, 200);
    ASSERT_EQ(v.colour.r, 0);
  });
  EXPECT_GT(seen, 100);
}

TEST(VoxelMap, blocks_keep_the_keyframe_that_made_them) {
  MapUnderTest t(small_camera());
  t.see(room(), turned(0), 2, 11);
  t.see(room(), turned(0.5), 2, 22);
  std::set<std::uint32_t> anchors;
  for (int i = 0; i < t.map().blocks().size(); ++i) {
    const Block& b = t.map().blocks().block(i);
    anchors.insert(b.anchor_keyframe);
    if (b.at == BlockCoordinates{0, 0, 9}) {
      EXPECT_EQ(b.anchor_keyframe, 11u);
    }
    EXPECT_LE(b.changed_sequence, b.fused_sequence);
  }
  EXPECT_EQ(anchors, (std::set<std::uint32_t>{11, 22}));
}

TEST(VoxelMap, far_from_the_origin_is_as_good_as_at_it) {
  MapUnderTest here(small_camera()), there(small_camera());
  // Whole blocks away, so that the same voxels must come out.
  const double far_m = 0.32 * 1'000'000;
  here.see(room(), turned(0.3), 3);
  const Scene moved = [&](Vec3 o, Vec3 d) { return room()(o - Vec3{far_m, -far_m, far_m}, d); };
  there.see(moved, turned(0.3, {far_m, -far_m, far_m}), 3);
  EXPECT_NEAR(static_cast<double>(there.map().occupied_voxels()),
              static_cast<double>(here.map().occupied_voxels()),
              0.01 * static_cast<double>(here.map().occupied_voxels()));
}

TEST(VoxelMap, point_reduction_is_readings_per_voxel) {
  for (const double voxel_m : {0.04, 0.16}) {  // of the second, every other row is gone through
    Config::Map config;
    config.voxel_m = voxel_m;
    MapUnderTest t(small_camera(), config);
    EXPECT_EQ(t.map().point_reduction(), 0);
    Picture p = t.render(wall(2.02), {});
    std::set<std::array<int, 3>> voxels;
    int points = 0;
    for (int y = 0; y < 120; ++y) {
      for (int x = 0; x < 160; ++x) {
        const RayTable::Ray ray = t.rays().at(x, y);
        const auto index = [&](double m) { return static_cast<int>(std::floor(m / voxel_m)); };
        voxels.insert({index(ray.x * 2.02), index(ray.y * 2.02), index(2.02)});
        ++points;
      }
    }
    const double expected = points / static_cast<double>(voxels.size());
    for (int frame = 0; frame < 2; ++frame) {
      ASSERT_EQ(t.map().fuse(t.input(p, {})), FuseOutcome::Fused);
      EXPECT_NEAR(t.map().point_reduction(), expected, 0.01 * expected) << voxel_m;
    }
  }
}

TEST(VoxelMap, rows_are_gone_through_in_turn_where_a_voxel_is_several_high) {
  Config::Map config;
  config.voxel_m = 0.16;  // 4.6 rows at the far end of 4.5 m
  MapUnderTest t(small_camera(), config);
  Picture p = t.render(wall(4.4), {});
  for (int y = 0; y < 120; ++y) {
    if (y != 60) std::fill_n(p.depth.begin() + 160 * y, 160, std::uint16_t{0});
  }
  std::vector<std::uint64_t> used;
  for (int frame = 0; frame < 2; ++frame) {
    ASSERT_EQ(t.map().fuse(t.input(p, {})), FuseOutcome::Fused);
    used.push_back(t.map().usage().high_water);
  }
  std::ranges::sort(used);
  EXPECT_EQ(used.front(), 0u) << "one of two frames passes over the only row that has depth";
  EXPECT_GT(used.back(), 0u);
}

/// How many blocks were fused last with a frame, of those whose z, in blocks, is this.
int blocks_fused(const VoxelMap& map, std::uint64_t sequence, int z) {
  int blocks = 0;
  for (int i = 0; i < map.blocks().size(); ++i) {
    const Block& block = map.blocks().block(i);
    blocks += block.at.z == z && block.fused_sequence == sequence ? 1 : 0;
  }
  return blocks;
}

TEST(VoxelMap, a_view_of_more_blocks_than_a_frame_fuses_is_fused_in_turn) {
  Config::Map config;
  config.voxel_m = 0.02;
  MapUnderTest t(small_camera(), config);
  const int z = 18;  // blocks of 16 cm
  t.see(wall(3.01));
  ASSERT_GT(t.map().blocks().size(), VoxelMap::kMostBlocksFused);
  EXPECT_EQ(blocks_fused(t.map(), 1, z), VoxelMap::kMostBlocksFused);
  t.see(wall(3.01));
  EXPECT_EQ(blocks_fused(t.map(), 2, z), VoxelMap::kMostBlocksFused);
  EXPECT_EQ(blocks_fused(t.map(), 0, z), 0) << "the second frame begins where the first ended";
}

TEST(VoxelMap, what_is_only_seen_through_waits_where_a_view_is_of_more_blocks_than_a_frame_fuses) {
  Config::Map config;
  config.voxel_m = 0.02;
  MapUnderTest t(small_camera(), config);
  const int near = 10, far = 12;  // blocks of 16 cm
  t.see(wall(1.69));
  const int wall_then = blocks_fused(t.map(), 1, near);
  t.see(wall(2.01));
  const int wall_now = blocks_fused(t.map(), 2, far), seen_through = blocks_fused(t.map(), 2, near);
  ASSERT_LT(wall_now, VoxelMap::kMostBlocksFused);
  ASSERT_GT(wall_now + wall_then, VoxelMap::kMostBlocksFused);
  EXPECT_EQ(blocks_fused(t.map(), 0, far), 0) << "all that has points";
  EXPECT_EQ(wall_now + seen_through, VoxelMap::kMostBlocksFused);
  t.see(wall(2.01), {}, 5);
  EXPECT_EQ(blocks_fused(t.map(), 7, far), wall_now);
  EXPECT_EQ(blocks_fused(t.map(), 1, near), 0) << "the others' turn has come";
}

TEST(VoxelMap, bad_input_is_refused_and_changes_nothing) {
  MapUnderTest t(small_camera());
  t.see(wall(2.02), {}, 3);
  const std::string before = bytes_of(t.map());
  Picture p = t.render(wall(1), {});
  const auto outcome = [&](auto&& spoil) {
    FuseInput input = t.input(p, {});
    spoil(input);
    return t.map().fuse(input);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(outcome([](FuseInput& i) { i.depth.width = 159; }), FuseOutcome::WrongSize);
  EXPECT_EQ(outcome([](FuseInput& i) { i.colour = {}; }), FuseOutcome::WrongSize);
  EXPECT_EQ(outcome([&](FuseInput& i) { i.T_map_camera_depth.t.x = nan; }), FuseOutcome::WrongPose);
  EXPECT_EQ(outcome([&](FuseInput& i) { i.T_map_camera_colour.R.m[4] = nan; }), FuseOutcome::WrongPose);
  EXPECT_EQ(outcome([](FuseInput& i) { i.T_map_camera_depth.R.m[0] = 2; }), FuseOutcome::WrongPose);
  EXPECT_EQ(outcome([](FuseInput& i) { i.T_map_camera_depth.R.m.fill(0); }), FuseOutcome::WrongPose);
  EXPECT_EQ(outcome([](FuseInput& i) { i.T_map_camera_depth.t.z = 1e7; }), FuseOutcome::WrongPose);
  p.mask.rule = DynamicRule::Silhouette;
  EXPECT_EQ(outcome([](FuseInput&) {}), FuseOutcome::WrongMask) << "no cells";
  p.mask.columns = 20;
  p.mask.rows = 14;
  EXPECT_EQ(outcome([](FuseInput&) {}), FuseOutcome::WrongMask) << "cells end above the picture";
  p.mask.rows = 1000;
  EXPECT_EQ(outcome([](FuseInput&) {}), FuseOutcome::WrongMask) << "more cells than there can be";
  EXPECT_EQ(bytes_of(t.map()), before);
  EXPECT_EQ(t.map().fused_frames(), 3u);
}

TEST(VoxelMap, random_depth_does_no_harm) {
  MapUnderTest t(small_camera(true));
  std::uint32_t state = 1;
  for (int frame = 0; frame < 20; ++frame) {
    Picture p = t.render(wall(1), {});
    for (std::uint16_t& raw : p.depth)
      raw = static_cast<std::uint16_t>((state = state * 1664525u + 1013904223u) >> 16);
    ASSERT_EQ(t.map().fuse(t.input(p, turned(frame))), FuseOutcome::Fused);
  }
  EXPECT_LE(t.map().blocks().blocks_used(), t.map().usage().capacity);
}

}  // namespace
}  // namespace stillmap
