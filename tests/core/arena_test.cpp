// SPDX-License-Identifier: Apache-2.0
#include "core/arena.h"

#include <gtest/gtest.h>

#include "core/camera.h"
#include "core/frame_pool.h"

namespace stillmap {
namespace {

struct Odd {
  char bytes[13] = {'x'};
};

/// Takes of many sizes and alignments, as stages do.
void take_all(Arena& arena) {
  FramePool pool(arena, 3, 17, 5);
  CameraModel camera;
  camera.width = 19;
  camera.height = 7;
  camera.fx = camera.fy = 20;
  RayTable rays(arena, camera);
  (void)arena.take<Odd>("odd", 11);
  (void)arena.take<double>("none", 0);
  (void)arena.take<std::uint8_t>("byte", 1);
}

TEST(Arena, APlanIsExactlyWhatARunTakes) {
  Arena plan;
  take_all(plan);
  Arena real(plan.bytes_planned());  // one byte too few would abort below
  take_all(real);
  EXPECT_TRUE(plan.planning());
  EXPECT_FALSE(real.planning());
  EXPECT_EQ(real.bytes_planned(), plan.bytes_planned());
  ASSERT_EQ(real.lines().size(), plan.lines().size());
  for (std::size_t i = 0; i < plan.lines().size(); ++i) {
    EXPECT_STREQ(real.lines()[i].name, plan.lines()[i].name);
    EXPECT_EQ(real.lines()[i].bytes(), plan.lines()[i].bytes());
  }
}

TEST(Arena, PlanningGivesOutNothing) {
  Arena plan;
  EXPECT_TRUE(plan.take<int>("ints", 1000).empty());
  EXPECT_EQ(plan.lines()[0].bytes(), 4000u);
  EXPECT_GE(plan.bytes_planned(), 4000u);
}

TEST(Arena, PiecesAreInitialisedApartAndOnTheirOwnCacheLine) {
  Arena arena(4096);
  const auto a = arena.take<Odd>("a", 3);
  const auto b = arena.take<std::uint64_t>("b", 5);
  ASSERT_EQ(a.size(), 3u);
  ASSERT_EQ(b.size(), 5u);
  EXPECT_EQ(a[2].bytes[0], 'x');
  for (std::uint64_t v : b) EXPECT_EQ(v, 0u);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(a.data()) % 64, 0u);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(b.data()) % 64, 0u);
  EXPECT_GE(reinterpret_cast<std::byte*>(b.data()), reinterpret_cast<std::byte*>(a.data() + a.size()));
}

TEST(ArenaDeathTest, TakingMoreThanPlannedIsABug) {
  EXPECT_DEATH(
      {
        Arena arena(128);
        (void)arena.take<std::uint8_t>("fits", 128);
        (void)arena.take<std::uint8_t>("too much", 1);
      },
      "bug: used_ <= capacity_");
}

}  // namespace
}  // namespace stillmap
