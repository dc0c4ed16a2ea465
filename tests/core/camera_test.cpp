// SPDX-License-Identifier: Apache-2.0
#include "core/camera.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace stillmap {
namespace {

CameraModel fr1() {
  CameraModel c;
  c.width = 640;
  c.height = 480;
  c.fx = 517.3, c.fy = 516.5, c.cx = 318.6, c.cy = 255.3;
  c.k1 = 0.2624, c.k2 = -0.9531, c.p1 = -0.0054, c.p2 = 0.0026, c.k3 = 1.1633;
  c.depth_units_per_m = 5000;
  return c;
}

TEST(CameraModel, ProjectsAsThePinholeWithoutDistortion) {
  CameraModel c = fr1();
  c.k1 = c.k2 = c.p1 = c.p2 = c.k3 = 0;
  const Vec2 p = c.project({0.5, -0.25, 2});
  EXPECT_NEAR(p.x, 517.3 * 0.25 + 318.6, 1e-12);
  EXPECT_NEAR(p.y, 516.5 * -0.125 + 255.3, 1e-12);
}

TEST(CameraModel, DistortsByThePlumbBobFormula) {
  // By hand for (x, y) = (0.3, -0.2): r2 = 0.13, radial = 1 + k1 r2 + k2 r2^2 + k3 r2^3.
  const double radial = 1 + 0.2624 * 0.13 - 0.9531 * 0.0169 + 1.1633 * 0.002197;
  const double x = 0.3 * radial + 2 * -0.0054 * 0.3 * -0.2 + 0.0026 * (0.13 + 2 * 0.09);
  const double y = -0.2 * radial + -0.0054 * (0.13 + 2 * 0.04) + 2 * 0.0026 * 0.3 * -0.2;
  const Vec2 p = fr1().project({0.6, -0.4, 2});
  EXPECT_NEAR(p.x, 517.3 * x + 318.6, 1e-9);
  EXPECT_NEAR(p.y, 516.5 * y + 255.3, 1e-9);
}

TEST(CameraModel, UndistortTurnsProjectAroundOnEveryPixelCornersIncluded) {
  const CameraModel c = fr1();
  double worst_px = 0;
  for (int y = 0; y < c.height; ++y) {
    for (int x = 0; x < c.width; ++x) {
      const Vec2 ray = c.undistort({static_cast<double>(x), static_cast<double>(y)});
      const Vec2 back = c.project({3 * ray.x, 3 * ray.y, 3});
      worst_px = std::max({worst_px, std::abs(back.x - x), std::abs(back.y - y)});
    }
  }
  EXPECT_LT(worst_px, 1e-6);
}

TEST(CameraModel, DepthOutOfTheTrustedRangeIsNone) {
  const CameraModel c = fr1();
  EXPECT_EQ(c.depth_m(0), 0);
  EXPECT_EQ(c.depth_m(1499), 0);
  EXPECT_DOUBLE_EQ(c.depth_m(1500), 0.3);
  EXPECT_DOUBLE_EQ(c.depth_m(10000), 2);
  EXPECT_DOUBLE_EQ(c.depth_m(40000), 8);
  EXPECT_EQ(c.depth_m(40001), 0);
  EXPECT_DOUBLE_EQ(c.depth_sigma_m(2), 0.01);
}

TEST(RayTable, HoldsTheUndistortedRayOfEveryPixel) {
  const CameraModel c = fr1();
  Arena plan;
  RayTable planned(plan, c);
  Arena arena(plan.bytes_planned());
  const RayTable rays(arena, c);
  for (const auto& [x, y] : {std::pair(0, 0), {639, 0}, {0, 479}, {639, 479}, {320, 240}, {100, 400}}) {
    const Vec2 exact = c.undistort({static_cast<double>(x), static_cast<double>(y)});
    EXPECT_NEAR(rays.at(x, y).x, exact.x, 1e-7);
    EXPECT_NEAR(rays.at(x, y).y, exact.y, 1e-7);
  }
}

}  // namespace
}  // namespace stillmap
