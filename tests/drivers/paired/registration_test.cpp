// SPDX-License-Identifier: Apache-2.0
#include "drivers/paired/registration.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/heap_calls.h"

namespace stillmap {
namespace {

CameraModel camera(int width, int height, double f) {
  CameraModel c;
  c.width = width, c.height = height;
  c.fx = c.fy = f;
  c.cx = width / 2.0, c.cy = height / 2.0;
  c.depth_units_per_m = 1000;
  return c;
}

struct Depth {
  Depth(int w, int h, std::uint16_t fill = 0)
      : width(w), height(h), readings(static_cast<std::size_t>(w * h), fill) {}
  std::uint16_t& at(int x, int y) { return readings[static_cast<std::size_t>(y * width + x)]; }
  ImageView<std::uint16_t> view() { return {readings.data(), width, height, width}; }
  int width, height;
  std::vector<std::uint16_t> readings;
};

TEST(Registration, TheSameCameraChangesNothing) {
  CameraModel c = camera(64, 48, 60);
  c.k1 = 0.1, c.p1 = 0.01;
  DepthRegistration registration(c, c, {});
  Depth from(64, 48), into(64, 48, 77);
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 64; ++x)
      from.at(x, y) = static_cast<std::uint16_t>(x % 7 == 0 ? 0 : 500 + 10 * x + y);
  }
  registration.apply(from.view(), into.view());
  EXPECT_EQ(into.readings, from.readings);
}

TEST(Registration, AWallMovesByTheParallax) {
  const CameraModel c = camera(64, 48, 60);
  // The depth camera stands 0.1 m to the right of colour: at 2 m that is 60 * 0.1 / 2 = 3 px; 0.5 m behind
  // it, the wall at 2 m of depth is at 1.5 m of colour and everything is 4/3 as large.
  DepthRegistration beside(c, c, {Mat3{}, {0.1, 0, 0}});
  Depth wall(64, 48, 2000), into(64, 48);
  beside.apply(wall.view(), into.view());
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 64; ++x) ASSERT_EQ(into.at(x, y), x < 3 ? 0 : 2000) << x << ", " << y;
  }
  DepthRegistration behind(c, c, {Mat3{}, {0, 0, -0.5}});
  Depth mark(64, 48);
  mark.at(32 + 6, 24 - 3) = 2000;
  behind.apply(mark.view(), into.view());
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 64; ++x)
      ASSERT_EQ(into.at(x, y), x == 32 + 8 && y == 24 - 4 ? 1500 : 0) << x << ", " << y;
  }
}

TEST(Registration, ASmallDepthPictureLeavesNoHolesInALargeColourPicture) {
  const CameraModel colour = camera(160, 120, 150), depth = camera(64, 48, 60);
  DepthRegistration registration(colour, depth, {});
  Depth wall(64, 48, 2000), into(160, 120);
  registration.apply(wall.view(), into.view());
  int holes = 0;
  for (int y = 2; y < 117; ++y) {
    for (int x = 2; x < 157; ++x) holes += into.at(x, y) == 0;
  }
  EXPECT_EQ(holes, 0);
}

TEST(Registration, WhatTheNearThingHidesStaysHidden) {
  const CameraModel c = camera(64, 48, 60);
  DepthRegistration registration(c, c, {Mat3{}, {0.1, 0, 0}});
  Depth from(64, 48, 3000), into(64, 48);
  for (int y = 10; y < 30; ++y) {
    for (int x = 20; x < 30; ++x) from.at(x, y) = 1000;
  }
  registration.apply(from.view(), into.view());
  // The near thing moves by 6 px, the wall by 2: the wall's 28..31 come to 30..33, beneath the near 26..35,
  // and the wall that the depth camera could not see (20..29, moved by 2: 22..31) is a hole where the near
  // thing has left it, 22..25.
  for (int x = 2; x < 64; ++x) {
    const int expected = x >= 26 && x < 36 ? 1000 : x >= 22 && x < 26 ? 0 : 3000;
    ASSERT_EQ(into.at(x, 20), expected) << x;
    ASSERT_EQ(into.at(x, 5), 3000) << x;
  }
}

TEST(Registration, FollowsBothLensesAndARotation) {
  CameraModel colour = camera(160, 120, 150), depth = camera(128, 96, 110);
  colour.k1 = 0.08, colour.k2 = -0.05, colour.p1 = 0.05, colour.p2 = 0.03;
  depth.k1 = -0.06, depth.p1 = 0.002;
  const Pose T_colour_depth{exp_so3({0.01, -0.03, 0.02}), {0.05, -0.01, 0.004}};
  DepthRegistration registration(colour, depth, T_colour_depth);
  for (const auto& [x, y, z] : {std::tuple(64, 48, 1.5), {10, 80, 0.7}, {120, 10, 3.0}, {100, 60, 6.0}}) {
    const Vec2 ray = depth.undistort({static_cast<double>(x), static_cast<double>(y)});
    const Vec3 p = T_colour_depth * Vec3{z * ray.x, z * ray.y, z};
    const Vec2 pixel = colour.project(p);
    Depth from(128, 96), into(160, 120);
    from.at(x, y) = static_cast<std::uint16_t>(z * 1000);
    registration.apply(from.view(), into.view());
    const int u = static_cast<int>(std::lround(pixel.x)), v = static_cast<int>(std::lround(pixel.y));
    if (u < 0 || v < 0 || u >= 160 || v >= 120) continue;
    EXPECT_NEAR(into.at(u, v), p.z * 1000, 1) << x << ", " << y;
    int covered = 0;
    for (const std::uint16_t r : into.readings) covered += r != 0;
    EXPECT_LE(covered, 4) << "a reading's footprint is 1.4 px wide";
  }
}

TEST(Registration, ReadingsBehindOrFarOutsideFallNowhere) {
  CameraModel colour = camera(64, 48, 60);
  colour.k1 = -0.2;  // folds far outside of the picture: a ray at 66 degrees must not come back into it
  const CameraModel depth = camera(64, 48, 12);
  Depth from(64, 48), into(64, 48, 5);
  from.at(5, 24) = 1000;
  DepthRegistration(colour, depth, {}).apply(from.view(), into.view());
  EXPECT_EQ(std::count(into.readings.begin(), into.readings.end(), 0), 64 * 48);
  Depth near(64, 48, 400);
  DepthRegistration(camera(64, 48, 60), camera(64, 48, 60), {Mat3{}, {0, 0, -0.5}})
      .apply(near.view(), into.view());
  EXPECT_EQ(std::count(into.readings.begin(), into.readings.end(), 0), 64 * 48);
}

TEST(Registration, TakesNothingFromTheHeap) {
  const CameraModel c = camera(64, 48, 60);
  DepthRegistration registration(c, c, {Mat3{}, {0.1, 0, 0}});
  Depth wall(64, 48, 2000), into(64, 48);
  const long before = test::heap_calls();
  registration.apply(wall.view(), into.view());
  EXPECT_EQ(test::heap_calls(), before);
}

}  // namespace
}  // namespace stillmap
