// SPDX-License-Identifier: Apache-2.0
// The voxel map within its fixed memory: capacity, plan, heap, and the same result from the same frames.
#include <gtest/gtest.h>

#include <string>

#include "map/voxel_map.h"
#include "map_scene.h"
#include "tests/support/heap_calls.h"

namespace stillmap {
namespace {

using test::bytes_of;
using test::MapUnderTest;
using test::meet_plane;
using test::Picture;
using test::room;
using test::Scene;
using test::small_camera;
using test::turned;

constexpr Bgr kGrey{90, 90, 90};

TEST(VoxelMapMemory, a_long_path_stays_within_capacity_and_keeps_what_is_near) {
  Config::Map config;
  config.capacity_voxels = 300 * kBlockVoxels;
  MapUnderTest t(small_camera(), config);
  // A corridor without end, 2 m wide.
  const Scene corridor = [](Vec3 o, Vec3 d) {
    return meet_plane(o, d, {d.x > 0 ? 1.0 : -1.0, 0, 0}, 1.02, kGrey);
  };
  for (int i = 0; i < 400; ++i) {
    const Pose here = turned(0, {0, 0, 0.1 * i});
    t.see(corridor, here);
    ASSERT_LE(t.map().blocks().blocks_used(), 300u);
  }
  EXPECT_GT(t.map().blocks_evicted(), 500u);
  EXPECT_EQ(t.map().usage().high_water, 300u);
  EXPECT_EQ(t.map().at({1.02, 0, 42}), Occupancy::Occupied);
  EXPECT_EQ(t.map().at({1.02, 0, 5}), Occupancy::Unknown) << "far behind: given up";
  std::uint64_t counted = 0;
  t.map().for_each_occupied([&](const OccupiedVoxel&) { ++counted; });
  EXPECT_EQ(counted, t.map().occupied_voxels());
}

TEST(VoxelMapMemory, a_planning_arena_is_asked_for_the_same) {
  MapUnderTest t(small_camera());
  EXPECT_EQ(MapUnderTest::planned_bytes(small_camera(), {}), t.arena().bytes_planned());
  for (const PlanLine& line : t.arena().lines()) {
    if (std::string(line.name) == "map_voxels") {
      EXPECT_LE(line.bytes(), 16'000'000u);
    }
  }
}

TEST(VoxelMapMemory, takes_nothing_from_the_heap) {
  Config::Map config;
  config.capacity_voxels = 100 * kBlockVoxels;  // small enough to evict
  MapUnderTest t(small_camera(true), config);
  Picture ahead = t.render(room(), {}), aside = t.render(room(), turned(1.5));
  const long before = test::heap_calls();
  for (int i = 0; i < 10; ++i) {
    (void)t.map().fuse(t.input(ahead, {}));
    (void)t.map().fuse(t.input(aside, turned(1.5, {0, 0, 0.5 * i})));
  }
  std::uint64_t counted = 0;
  t.map().for_each_occupied([&](const OccupiedVoxel&) { ++counted; });
  EXPECT_EQ(test::heap_calls(), before);
  EXPECT_GT(t.map().blocks_evicted(), 0u);
}

TEST(VoxelMapMemory, the_same_frames_give_the_same_map) {
  Config::Map config;
  config.capacity_voxels = 150 * kBlockVoxels;
  MapUnderTest a(small_camera(true), config), b(small_camera(true), config);
  for (int i = 0; i < 40; ++i) {
    a.see(room(), turned(0.1 * i));
    b.see(room(), turned(0.1 * i));
  }
  EXPECT_GT(a.map().blocks_evicted(), 0u);
  EXPECT_GT(a.map().occupied_voxels(), 100u);
  EXPECT_EQ(bytes_of(a.map()), bytes_of(b.map()));
}

}  // namespace
}  // namespace stillmap
