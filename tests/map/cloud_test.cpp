// SPDX-License-Identifier: Apache-2.0
#include "map/cloud.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "map_scene.h"

namespace stillmap {
namespace {

struct CloudUnderTest {
  test::MapUnderTest map{test::small_camera()};
  CloudUnderTest() { map.see(test::room(), test::turned(0.4), 3); }
  std::vector<CloudPoint> cloud(std::size_t room_for) {
    std::vector<CloudPoint> points(room_for);
    points.resize(make_cloud(map.map(), points));
    return points;
  }
};

/// Every point lies on one of the room's walls within `tolerance`, in that wall's colour.
void expect_on_walls(const std::vector<CloudPoint>& points, double tolerance) {
  for (const CloudPoint& p : points) {
    const double off =
        std::min({std::abs(std::abs(p.x) - 3), std::abs(std::abs(p.y) - 2), std::abs(std::abs(p.z) - 3)});
    ASSERT_LT(off, tolerance) << p.x << " " << p.y << " " << p.z;
    ASSERT_EQ(p.a, 255);
    ASSERT_GT(p.r + p.g + p.b, 150);
  }
}

/// No occupied voxel is farther than a block from a point.
void expect_whole(const VoxelMap& map, const std::vector<CloudPoint>& points) {
  map.for_each_occupied([&](const OccupiedVoxel& v) {
    const bool shown = std::ranges::any_of(points, [&](const CloudPoint& p) {
      return std::abs(p.x - v.x) < 0.33 && std::abs(p.y - v.y) < 0.33 && std::abs(p.z - v.z) < 0.33;
    });
    ASSERT_TRUE(shown) << v.x << " " << v.y << " " << v.z;
  });
}

TEST(Cloud, is_every_voxel_where_they_fit) {
  CloudUnderTest t;
  const std::vector<CloudPoint> points = t.cloud(200'000);
  ASSERT_EQ(points.size(), t.map.map().occupied_voxels());
  std::size_t i = 0;
  t.map.map().for_each_occupied([&](const OccupiedVoxel& v) {
    EXPECT_EQ(points[i].x, v.x);
    EXPECT_EQ(points[i].z, v.z);
    EXPECT_EQ(points[i].r, v.colour.r);
    EXPECT_EQ(points[i++].b, v.colour.b);
  });
  EXPECT_EQ(t.cloud(points.size()).size(), points.size()) << "an exact fit is a fit";
}

TEST(Cloud, gets_coarser_until_it_fits_and_still_shows_all_of_the_map) {
  CloudUnderTest t;
  const auto voxels = static_cast<std::size_t>(t.map.map().occupied_voxels());
  std::size_t blocks = 0;
  for (int i = 0; i < t.map.map().blocks().size(); ++i) blocks += t.map.map().blocks().block(i).occupied > 0;
  std::size_t last = voxels;
  for (const std::size_t room_for : {voxels - 1, voxels / 4, voxels / 16, blocks}) {
    const std::vector<CloudPoint> points = t.cloud(room_for);
    ASSERT_LE(points.size(), room_for);
    EXPECT_GT(points.size(), room_for / 8);
    EXPECT_LE(points.size(), last);
    last = points.size();
    expect_on_walls(points, 0.17);
    expect_whole(t.map.map(), points);
  }
  EXPECT_EQ(last, blocks);
}

TEST(Cloud, shows_evenly_spread_blocks_where_not_even_these_fit) {
  CloudUnderTest t;
  EXPECT_EQ(t.cloud(10).size(), 10u);
  EXPECT_EQ(t.cloud(1).size(), 1u);
  EXPECT_EQ(t.cloud(0).size(), 0u);
  expect_on_walls(t.cloud(10), 0.17);
}

TEST(Cloud, of_an_empty_map_is_empty) {
  test::MapUnderTest empty(test::small_camera());
  std::vector<CloudPoint> points(5);
  EXPECT_EQ(make_cloud(empty.map(), points), 0u);
}

}  // namespace
}  // namespace stillmap
