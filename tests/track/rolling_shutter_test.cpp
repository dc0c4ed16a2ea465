// SPDX-License-Identifier: Apache-2.0
#include "track/rolling_shutter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "rolling_camera.h"

namespace stillmap {
namespace {

using test::exposed;
using test::kinect;

TEST(RollingShutter, WhatATurningCameraSawIsWhereAStandingOneSeesIt) {
  const CameraModel camera = kinect();
  const Vec3 turn{0.05, -0.03, 0.04};
  double furthest = 0;
  for (const Vec3 p : {Vec3{-0.9, -0.7, 2}, Vec3{0.8, 0.6, 2}, Vec3{0.1, -0.5, 1.5}, Vec3{-0.2, 1.1, 3}}) {
    Feature f = exposed(camera, turn, p);
    const Vec2 still = camera.project(p);
    furthest = std::max(furthest, std::hypot(f.x - still.x, f.y - still.y));
    straighten_rows(camera, turn, {&f, 1});
    EXPECT_NEAR(f.x, still.x, 0.02);
    EXPECT_NEAR(f.y, still.y, 0.02);
    EXPECT_NEAR(f.ray_x, p.x / p.z, 1e-5);
    EXPECT_NEAR(f.ray_y, p.y / p.z, 1e-5);
  }
  EXPECT_GT(furthest, 10);  // px: there was something to mend
}

TEST(RollingShutter, ACameraThatStandsSeesNoDifference) {
  const CameraModel camera = kinect();
  Feature f = exposed(camera, {}, {0.8, 0.6, 2});
  const Feature before = f;
  straighten_rows(camera, {}, {&f, 1});
  EXPECT_NEAR(f.x, before.x, 1e-3);
  EXPECT_NEAR(f.ray_y, before.ray_y, 1e-6);
}

}  // namespace
}  // namespace stillmap
