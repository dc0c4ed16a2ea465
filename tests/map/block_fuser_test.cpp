// SPDX-License-Identifier: Apache-2.0
#include "map/block_fuser.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>
#include <vector>

#include "map_scene.h"

namespace stillmap {
namespace {

/// One block before the camera: voxels of 4 cm at x, y in [0, 0.32), z in [1.28, 1.60), and a wall of one
/// depth.
struct FuserUnderTest {
  static constexpr std::uint16_t kMark = 5;
  CameraModel camera = test::small_camera();
  Arena arena{1 << 20};
  RayTable rays{arena, camera};
  MoverTrail trail{arena, camera, rays};
  BlockFuser fuser{arena, camera, rays, &trail, 0.04};
  std::vector<float> z_m = std::vector<float>(160 * 120);
  std::vector<Bgr> colour = std::vector<Bgr>(160 * 120, Bgr{10, 20, 30});
  std::array<Voxel, kBlockVoxels> voxels{};
  BlockCoordinates at{0, 0, 4};

  BlockFuser::Change fuse(float wall_m, const Pose& T_map_colour = {}) {
    std::fill(z_m.begin(), z_m.end(), wall_m);
    fuser.begin_frame({}, T_map_colour, z_m, {colour.data(), 160, 120, 160}, 4.5, kMark);
    return fuser.fuse(at, voxels);
  }
  /// The voxel at the block's near corner plus `layer` voxels along the optical axis; its centre is 1.30 m +
  /// 4 cm each.
  Voxel& layer(int layer) { return voxels[static_cast<std::size_t>(64 * layer)]; }
};

TEST(BlockFuser, says_free_before_the_wall_occupied_at_it_and_nothing_behind) {
  FuserUnderTest t;
  t.fuse(1.455f);  // the middle of layer 4; layers 3 and 5 are one voxel away
  for (int i = 0; i < 3; ++i) EXPECT_EQ(t.layer(i).log_odds, Voxel::kMiss) << i;
  EXPECT_EQ(t.layer(3).log_odds, 0);
  EXPECT_EQ(t.layer(4).log_odds, Voxel::kHit);
  for (int i = 5; i < 8; ++i) EXPECT_EQ(t.layer(i).log_odds, 0) << i;
}

TEST(BlockFuser, what_is_not_mapped_frees_the_ray_before_it_and_is_never_occupied) {
  FuserUnderTest t;
  t.fuse(-1.455f);
  EXPECT_EQ(t.layer(2).log_odds, Voxel::kMiss);
  for (int i = 3; i < 8; ++i) EXPECT_EQ(t.layer(i).log_odds, 0) << i;
}

TEST(BlockFuser, what_stands_where_something_went_has_its_own_colour) {
  FuserUnderTest t;
  for (int i = 0; i < 4; ++i) t.fuse(1.455f);
  for (int i = 0; i < 20 && t.layer(4).log_odds >= 0; ++i) t.fuse(3);
  ASSERT_LT(t.layer(4).log_odds, 0);
  std::ranges::fill(t.colour, Bgr{210, 220, 230});
  t.fuse(1.455f);
  EXPECT_EQ(t.layer(4).colour.b, 210);
  EXPECT_EQ(t.layer(4).colour.r, 230);
}

TEST(BlockFuser, no_reading_says_nothing) {
  FuserUnderTest t;
  const BlockFuser::Change change = t.fuse(0);
  for (const Voxel& v : t.voxels) EXPECT_EQ(v.log_odds, 0);
  EXPECT_FALSE(change.shown);
}

TEST(BlockFuser, enough_points_outweigh_a_ray_that_passes) {
  FuserUnderTest t;
  t.layer(0).last_hit = FuserUnderTest::kMark;
  t.layer(0).points = 255;
  t.layer(1).last_hit = FuserUnderTest::kMark;
  t.layer(1).points = 1;  // the tail of the noise: the face would fill some 14 pixels
  t.layer(2).last_hit = FuserUnderTest::kMark - 1;
  t.layer(2).points = 255;  // of an earlier frame
  t.fuse(3);
  EXPECT_EQ(t.layer(0).log_odds, Voxel::kHit);
  EXPECT_EQ(t.layer(1).log_odds, Voxel::kMiss);
  EXPECT_EQ(t.layer(2).log_odds, Voxel::kMiss);
}

TEST(BlockFuser, evidence_is_bounded_both_ways) {
  FuserUnderTest t;
  for (int i = 0; i < 50; ++i) t.fuse(1.455f);
  EXPECT_EQ(t.layer(4).log_odds, Voxel::kMax);
  EXPECT_EQ(t.layer(0).log_odds, Voxel::kMin);
}

TEST(BlockFuser, colour_is_the_mean_of_the_first_pictures_and_then_follows) {
  FuserUnderTest t;
  std::fill(t.colour.begin(), t.colour.end(), Bgr{0, 100, 200});
  t.fuse(1.455f);
  std::fill(t.colour.begin(), t.colour.end(), Bgr{100, 100, 100});
  t.fuse(1.455f);
  EXPECT_EQ(t.layer(4).colour.b, 50);
  EXPECT_EQ(t.layer(4).colour.g, 100);
  EXPECT_EQ(t.layer(4).colour.r, 150);
  std::fill(t.colour.begin(), t.colour.end(), Bgr{255, 255, 255});
  for (int i = 0; i < 100; ++i) t.fuse(1.455f);
  EXPECT_GT(t.layer(4).colour.b, 240);
}

TEST(BlockFuser, colour_comes_from_where_the_colour_camera_saw_the_voxel) {
  FuserUnderTest t;
  const Vec3 p{0.02, 0.02, 1.46};  // layer 4
  const Pose T_map_colour{exp_so3({0, 0.2, 0}), {0.1, 0.05, 0}};
  const Vec2 pixel = t.camera.project(inverse(T_map_colour) * p);
  const int u = static_cast<int>(std::lround(pixel.x)), v = static_cast<int>(std::lround(pixel.y));
  t.colour[static_cast<std::size_t>(v * 160 + u)] = {1, 2, 3};
  t.fuse(1.455f, T_map_colour);
  EXPECT_EQ(t.layer(4).colour.b, 1);
  EXPECT_EQ(t.layer(4).colour.r, 3);
}

TEST(BlockFuser, a_voxel_that_the_colour_camera_missed_waits) {
  FuserUnderTest t;
  t.fuse(1.455f, {exp_so3({0, 2, 0}), {}});
  EXPECT_EQ(t.layer(4).log_odds, 0);
}

TEST(BlockFuser, tells_what_changed) {
  FuserUnderTest t;
  EXPECT_FALSE(t.fuse(1.455f).shown) << "one hit is not occupied yet";
  const BlockFuser::Change second = t.fuse(1.455f);
  EXPECT_TRUE(second.shown);
  EXPECT_EQ(second.occupied, 64);
  EXPECT_FALSE(t.fuse(1.455f).shown) << "the same again";
  t.colour.assign(t.colour.size(), {200, 200, 200});
  EXPECT_TRUE(t.fuse(1.455f).shown) << "another colour";
  for (int i = 0; i < 3; ++i) t.fuse(3);
  bool vanished = false;
  BlockFuser::Change last;
  for (int i = 0; i < 5; ++i) {
    last = t.fuse(3);
    vanished |= last.shown;
  }
  EXPECT_TRUE(vanished);
  EXPECT_EQ(last.occupied, 0);
}

TEST(BlockFuser, sees_blocks_in_its_view_only) {
  FuserUnderTest t;
  t.fuse(1.5f);
  EXPECT_TRUE(t.fuser.in_view({0, 0, 4}));
  EXPECT_FALSE(t.fuser.in_view({0, 0, -4}));
  EXPECT_FALSE(t.fuser.in_view({20, 0, 4}));
  EXPECT_FALSE(t.fuser.in_view({0, -20, 4}));
  EXPECT_FALSE(t.fuser.in_view({0, 0, 16})) << "beyond the range of 4.5 m";
}

/// Patches of many depths, some unmapped, some without reading, before a lens that bends, from many sides.
TEST(BlockFuser, nothing_can_be_told_of_what_is_hidden) {
  const CameraModel camera = test::small_camera(true);
  Arena arena{1 << 20};
  const RayTable rays(arena, camera);
  BlockFuser fuser(arena, camera, rays, nullptr, 0.04);
  std::mt19937 random(5);
  const std::vector<Bgr> colour(160 * 120);
  std::vector<float> z_m(160 * 120);
  int in_view = 0, hidden = 0, told = 0;
  for (int round = 0; round < 20; ++round) {
    const std::size_t patch = 1 + random() % 40;
    std::vector<float> patches(160 * 120);
    for (float& z : patches)
      z = std::array{1.0f, -1.0f, 1.0f, 0.0f}[random() % 4] *
          (0.5f + 0.001f * static_cast<float>(random() % 2500));
    for (std::size_t i = 0; i < z_m.size(); ++i) z_m[i] = patches[i / 160 / patch * 160 + i % 160 / patch];
    const Pose T{exp_so3({0.3 * round, 0.7 * round, 0}), {0.1, 0.2, 0.3}};
    fuser.begin_frame(T, T, z_m, {colour.data(), 160, 120, 160}, 4.5, 1);
    for (std::int32_t i = 0; i < 28 * 28 * 28; ++i) {
      const BlockCoordinates at{i % 28 - 14, i / 28 % 28 - 14, i / (28 * 28) - 14};
      if (!fuser.in_view(at)) {
        EXPECT_FALSE(fuser.may_tell(at));
        continue;
      }
      ++in_view;
      std::array<Voxel, kBlockVoxels> voxels{};
      fuser.fuse(at, voxels);
      const bool tells = std::ranges::any_of(voxels, [](const Voxel& v) { return v.log_odds != 0; });
      if (fuser.may_tell(at)) {
        told += static_cast<int>(tells);
      } else {
        ++hidden;
        ASSERT_FALSE(tells) << at.x << " " << at.y << " " << at.z << " in round " << round;
      }
    }
  }
  EXPECT_GT(told, 1000);
  EXPECT_GT(hidden, in_view / 4);
}

}  // namespace
}  // namespace stillmap
