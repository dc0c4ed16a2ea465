// SPDX-License-Identifier: Apache-2.0
#include "map/free_space.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "map_scene.h"

namespace stillmap {
namespace {

using test::MapUnderTest;
using test::small_camera;
using test::turned;
using test::wall;

/// A camera at the origin that looks at one depth everywhere.
struct FreeSpaceTest : testing::Test {
  void see(float z_m, const Pose& T = {}) {
    const std::vector<float> all(160 * 120, z_m);
    space.see(T, all);
  }
  /// Of the cubes on the optical axis, 32 cm each, which are free.
  std::string along_axis() const {
    std::string text;
    for (int z = 0; z < 14; ++z) text += space.free({0, 0, z}) && space.free({-1, -1, z}) ? 'f' : '.';
    return text;
  }
  CameraModel camera = small_camera();
  Arena arena{4 << 20};
  RayTable rays{arena, camera};
  FreeSpace space{arena, camera, rays, 0.04, 4.5};
};

TEST_F(FreeSpaceTest, IsWhatLiesWhollyInViewAndBeforeWhatWasMeasured) {
  EXPECT_EQ(along_axis(), "..............");
  see(2.0f);  // the cube from 1.92 m on is not whole; those nearest are higher than the view
  EXPECT_EQ(along_axis(), "...fff........");
  see(-4.4f);  // what is not mapped frees the ray before it
  EXPECT_EQ(along_axis(), "...ffffffffff.");
}

TEST_F(FreeSpaceTest, WithoutReadingsNothingIsSaid) {
  see(0);
  EXPECT_EQ(along_axis(), "..............");
}

TEST_F(FreeSpaceTest, WhereSomethingStandsItEnds) {
  see(4.0f);
  space.fill({0, 0, 5});
  EXPECT_FALSE(space.free({0, 0, 5}));
  EXPECT_TRUE(space.free({0, 0, 6}));
  space.fill({500, 0, 0});  // never seen
  space.clear();
  EXPECT_EQ(along_axis(), "..............");
}

TEST_F(FreeSpaceTest, SmallBlocksShareACube) {
  FreeSpace fine(arena, camera, rays, 0.01, 4.5);  // blocks of 8 cm, cubes of 32 cm
  const std::vector<float> all(160 * 120, 2.0f);
  fine.see({}, all);
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(fine.free({i, 0, 16 + i}));
  EXPECT_FALSE(fine.free({0, 0, 24}));
}

TEST_F(FreeSpaceTest, ALongWayStaysWithinItsMemory) {
  for (int i = 0; i < 4000; ++i) see(4.0f, turned(0.01 * i, {3.0 * i, 0, 0}));
  // The newest is known, and what it took the place of is not mistaken for it.
  const Pose T = turned(0.01 * 3999, {3.0 * 3999, 0, 0});
  const Vec3 ahead = T * Vec3{0, 0, 2};
  EXPECT_TRUE(space.free(block_of(voxel_at(1 / 0.04 * ahead))));
  EXPECT_FALSE(space.free(block_of(voxel_at(1 / 0.04 * (T * Vec3{0, 0, -2})))));
}

TEST(FreeSpaceOfAMap, AirIsFreeUntilSomethingIsPutThere) {
  MapUnderTest t(small_camera());
  t.see(wall(4), {}, 2);
  EXPECT_EQ(t.map().at({0.1, 0.1, 2}), Occupancy::Free);
  EXPECT_EQ(t.map().at({0.1, 0.1, 4.5}), Occupancy::Unknown);
  EXPECT_EQ(t.map().at({0.1, 0.1, -2}), Occupancy::Unknown);
  t.see(wall(2.02), {}, 2);
  EXPECT_EQ(t.map().at({0.1, 0.1, 2.02}), Occupancy::Occupied);
  EXPECT_EQ(t.map().at({0.1, 0.1, 2.2}), Occupancy::Unknown) << "behind it";
}

}  // namespace
}  // namespace stillmap
