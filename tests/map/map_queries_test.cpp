// SPDX-License-Identifier: Apache-2.0
#include "map/map_queries.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "core/random.h"
#include "map_scene.h"
#include "tests/support/heap_calls.h"

namespace stillmap {
namespace {

using test::MapUnderTest;
using test::Picture;
using test::room;
using test::small_camera;
using test::turned;
using test::wall;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// The room of map_scene, seen all round.
struct MapQueriesTest : testing::Test {
  MapQueriesTest() {
    for (int i = 0; i < 12; ++i) t.see(room(), turned(i * M_PI / 6), 2);
  }
  Vec3 random_point(Random& random, double reach) {
    const auto one = [&] { return reach * (2 * random.uniform() - 1); };
    return {one(), one(), one()};
  }
  MapUnderTest t{small_camera()};
  MapQueries queries{t.map(), true};
};

TEST_F(MapQueriesTest, SaysOfEveryVoxelWhatTheMapSays) {
  Random random(5);
  int known = 0;
  for (int i = 0; i < 200'000; ++i) {
    const Vec3 p = random_point(random, 3.2);
    ASSERT_EQ(queries.at(p), t.map().at(p));
    known += queries.at(p) != Occupancy::Unknown;
  }
  EXPECT_GT(known, 30'000);
  EXPECT_EQ(queries.at({kNaN, 0, 0}), Occupancy::Unknown);
  EXPECT_EQ(queries.at({1e9, 0, 0}), Occupancy::Unknown);
  EXPECT_EQ(queries.at({0, 0, 999'999}), Occupancy::Unknown);
}

TEST_F(MapQueriesTest, ACorrectionIsToldWhileItIsUnderWay) {
  const auto correction = std::make_unique<Correction>();
  correction->epoch = 1;
  ASSERT_TRUE(correction->keyframes.try_push_back({0, turned(0.3, {0.5, 0, 0})}));
  t.map().correct(*correction);
  Random random(6);
  while (t.map().correcting()) {
    t.map().continue_correction();
    for (int i = 0; i < 300; ++i) {
      const Vec3 p = random_point(random, 3.5);
      ASSERT_EQ(queries.at(p), t.map().at(p));
    }
  }
  for (int i = 0; i < 100'000; ++i) {
    const Vec3 p = random_point(random, 3.5);
    ASSERT_EQ(queries.at(p), t.map().at(p));
  }
}

TEST_F(MapQueriesTest, ARayFindsWhatFineStepsAlongItFind) {
  Random random(7);
  const double step_m = 0.0005;
  int walls = 0;
  for (int i = 0; i < 300; ++i) {
    const Vec3 from = random_point(random, 1), direction = random_point(random, 1);
    const Vec3 unit = 1 / norm(direction) * direction;
    const MapQueries::Ray ray = queries.cast_ray(from, direction, 4);
    std::optional<double> occupied, unknown;
    for (double d = 0; d <= 4 && !occupied; d += step_m) {
      const Occupancy here = queries.at(from + d * unit);
      if (here == Occupancy::Occupied) occupied = d;
      if (here == Occupancy::Unknown && !unknown) unknown = d;
    }
    // Steps can leap over the corner of a voxel, but find nothing that the ray does not.
    if (occupied) {
      ASSERT_TRUE(ray.occupied_m);
      EXPECT_LE(*ray.occupied_m, *occupied + 1e-9);
      EXPECT_EQ(queries.at(from + (*ray.occupied_m + 1e-7) * unit), Occupancy::Occupied);
      ++walls;
    }
    if (unknown) {
      ASSERT_TRUE(ray.unknown_m);
      EXPECT_LE(*ray.unknown_m, *unknown + 1e-9);
    }
    EXPECT_EQ(ray.is_free(), !ray.occupied_m && !ray.unknown_m);
  }
  EXPECT_GT(walls, 80);
}

TEST_F(MapQueriesTest, ARayAheadEndsAtTheWallAndIsFreeBeforeIt) {
  const MapQueries::Ray ray = queries.cast_ray({0.1, 0.1, 1}, {0, 0, 5}, 10);
  ASSERT_TRUE(ray.occupied_m);
  EXPECT_NEAR(*ray.occupied_m, 2, 0.05);
  EXPECT_FALSE(ray.unknown_m && *ray.unknown_m < 1.9);
  EXPECT_FALSE(queries.cast_ray({0.1, 0.1, 1}, {0, 0, 5}, 1.5).occupied_m);
  EXPECT_TRUE(queries.cast_ray({0.1, 0.1, 1}, {1e-3, 0, 1}, 1.5).is_free());
  // Right before itself the camera sees too little of a cube of air to call it free.
  EXPECT_EQ(queries.cast_ray({0, 0, 0}, {0, 0, 1}, 1.5).unknown_m, 0.0);
}

TEST_F(MapQueriesTest, WhatIsNoRayIsUnknown) {
  for (const Vec3 direction : {Vec3{}, Vec3{kNaN, 0, 1}, Vec3{INFINITY, 0, 0}}) {
    const MapQueries::Ray ray = queries.cast_ray({0, 0, 0}, direction, 10);
    EXPECT_FALSE(ray.is_free());
    EXPECT_EQ(ray.unknown_m, 0.0);
    EXPECT_FALSE(queries.sweep({0, 0, 0}, direction, 0.3, 10).is_free());
  }
  EXPECT_FALSE(queries.cast_ray({1e8, 0, 0}, {1, 0, 0}, 1).is_free());
  EXPECT_TRUE(queries.cast_ray({100, 0, 0}, {1, 0, 0}, 1e300).unknown_m) << "ends, however far it is to go";
}

TEST(MapQueriesOfAPost, ABodyMeetsWhatARayPasses) {
  // A post 10 cm wide, 30 cm beside the way, or a bar as far above it.
  for (const bool bar : {false, true}) {
    const test::Scene scene = [bar](Vec3 o, Vec3 d) {
      auto hit = test::meet_plane(o, d, {0, 0, 1}, 3, {1, 2, 3});
      const auto post = test::meet_plane(o, d, {0, 0, 1}, 2, {4, 5, 6});
      const auto across = [&] { return bar ? o.y + post->t * d.y : o.x + post->t * d.x; };
      if (post && std::abs(across() - 0.35) < 0.05) hit = post;
      return hit;
    };
    MapUnderTest t(small_camera());
    t.see(scene, {}, 3);
    const MapQueries queries(t.map(), true);
    EXPECT_NEAR(*queries.sweep({0, 0, 1}, {0, 0, 1}, 0.2, 5).occupied_m, 2, 0.05);
    EXPECT_NEAR(*queries.sweep({0, 0, 1}, {0, 0, 1}, 0.4, 5).occupied_m, 1, 0.05);
    EXPECT_NEAR(*queries.sweep({0, 0, 1}, {0, 0, 1}, 0, 5).occupied_m, 2, 0.05);
  }
}

TEST_F(MapQueriesTest, ASliceIsEachColumnsWorst) {
  const MapQueries::Slice slice{
      .x_m = -3.2, .y_m = -1, .from_z_m = -0.5, .to_z_m = 0.5, .columns = 160, .rows = 40};
  std::vector<Occupancy> cells(160 * 40);
  ASSERT_TRUE(queries.slice(slice, cells).ok());
  int occupied = 0, free = 0;
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 160; ++x) {
      Occupancy worst = Occupancy::Unknown;
      for (double z = -0.5 + 0.02; z < 0.5; z += 0.04) {
        const Occupancy here = t.map().at({-3.2 + 0.04 * x + 0.02, -1 + 0.04 * y + 0.02, z});
        if (here == Occupancy::Occupied || (here == Occupancy::Free && worst == Occupancy::Unknown))
          worst = here;
      }
      const Occupancy told = cells[static_cast<std::size_t>(160 * y + x)];
      EXPECT_EQ(told, worst) << x << ' ' << y;
      occupied += told == Occupancy::Occupied;
      free += told == Occupancy::Free;
    }
  }
  EXPECT_GT(occupied, 50);
  EXPECT_GT(free, 1000);
}

TEST_F(MapQueriesTest, ASliceWithoutHeightIsOneLayer) {
  std::vector<Occupancy> cells(160 * 40);
  ASSERT_TRUE(
      queries
          .slice({.x_m = -3.2, .y_m = -1, .from_z_m = 0.02, .to_z_m = 0.02, .columns = 160, .rows = 40},
                 cells)
          .ok());
  int known = 0;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const double x = -3.2 + 0.04 * static_cast<double>(i % 160) + 0.02,
                 y = -1 + 0.04 * static_cast<double>(i / 160) + 0.02;
    ASSERT_EQ(cells[i], t.map().at({x, y, 0.02}));
    known += cells[i] != Occupancy::Unknown;
  }
  EXPECT_GT(known, 1000);
}

TEST_F(MapQueriesTest, ASliceIsRefusedWithTheMend) {
  std::vector<Occupancy> cells(100);
  const MapQueries lying(t.map(), false);
  const Status no_up = lying.slice({.to_z_m = 1, .columns = 10, .rows = 10}, cells);
  ASSERT_FALSE(no_up.ok());
  EXPECT_EQ(no_up.error().exit_code, ExitCode::WrongConfig);
  EXPECT_NE(no_up.error().message.find("camera.T_base_camera"), std::string::npos);
  EXPECT_FALSE(queries.slice({.to_z_m = 1, .columns = 10, .rows = 11}, cells).ok());
  EXPECT_FALSE(queries.slice({.to_z_m = 1, .columns = 1'000'000, .rows = 1'000'000}, cells).ok());
  EXPECT_FALSE(queries.slice({.to_z_m = 1, .columns = 10, .rows = 0}, cells).ok());
  EXPECT_FALSE(queries.slice({.from_z_m = 1, .to_z_m = 0, .columns = 10, .rows = 10}, cells).ok());
  EXPECT_FALSE(queries.slice({.to_z_m = 21, .columns = 10, .rows = 10}, cells).ok());
  EXPECT_FALSE(queries.slice({.x_m = kNaN, .to_z_m = 1, .columns = 10, .rows = 10}, cells).ok());
  EXPECT_TRUE(queries.slice({.to_z_m = 1, .columns = 10, .rows = 10}, cells).ok());
}

TEST_F(MapQueriesTest, TakesNothingFromTheHeap) {
  std::vector<Occupancy> cells(100);
  const long before = test::heap_calls();
  (void)queries.at({1, 1, 1});
  (void)queries.sweep({0, 0, 0}, {0, 0, 1}, 0.2, 3);
  (void)queries.slice({.to_z_m = 1, .columns = 10, .rows = 10}, cells);
  EXPECT_EQ(test::heap_calls(), before);
}

TEST(MapQueriesAcrossThreads, NobodySeesWhatNeverWas) {
  // The camera goes along a wall without end, in a map so small that blocks give way all the time; ahead of
  // the wall is never anything, and behind it nothing is ever known.
  Config::Map config;
  config.capacity_voxels = 120 * kBlockVoxels;
  MapUnderTest t(small_camera(), config);
  const MapQueries queries(t.map(), true);
  std::atomic<bool> done{false};
  std::atomic<double> place{0};
  std::atomic<int> wrong{0};
  std::atomic<std::uint64_t> seen_free{0}, seen_occupied{0};
  const auto ask = [&](std::uint64_t seed) {
    Random random(seed);
    while (!done.load()) {
      const double x = place.load() + 4 * random.uniform() - 2, y = 2 * random.uniform() - 1;
      const Occupancy before = queries.at({x, y, 1.0}), at = queries.at({x, y, 1.621}),
                      behind = queries.at({x, y, 1.9});
      wrong += before == Occupancy::Occupied || at == Occupancy::Free || behind != Occupancy::Unknown;
      seen_free += before == Occupancy::Free;
      seen_occupied += at == Occupancy::Occupied;
      const MapQueries::Ray ray = queries.cast_ray({x, y, 1.0}, {0, 0, 1}, 1);
      wrong += ray.occupied_m && *ray.occupied_m < 0.5;
    }
  };
  std::thread one(ask, 1), two(ask, 2);
  for (int i = 0; i < 60 || ((seen_free == 0 || seen_occupied == 0) && i < 10'000); ++i) {
    place = 0.1 * i;
    t.see(wall(1.62), {{}, {0.1 * i, 0, 0}});
  }
  done = true;
  one.join();
  two.join();
  EXPECT_GT(t.map().blocks_evicted(), 0u);
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(seen_free, 0u);
  EXPECT_GT(seen_occupied, 0u);
}

}  // namespace
}  // namespace stillmap
