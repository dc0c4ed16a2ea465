// SPDX-License-Identifier: Apache-2.0
#include "track/depth_sampling.h"

#include <gtest/gtest.h>

#include <cmath>

#include "scene.h"

namespace stillmap {
namespace {

using test::Image;

constexpr double kUnits = 5000;
std::uint16_t raw(double z_m) {
  return static_cast<std::uint16_t>(std::lround(z_m * kUnits));
}

class DepthSampling : public testing::Test {
 protected:
  CameraModel camera_ = synthetic::SyntheticLog::camera();
  Image<std::uint16_t> depth_{640, 480, raw(2)};

  double at(double x, double y, const Pose& T_depth_colour = {}) const {
    const Vec2 ray = camera_.undistort({x, y});
    Feature f;
    f.ray_x = static_cast<float>(ray.x);
    f.ray_y = static_cast<float>(ray.y);
    f.depth_m = 77;  // must be overwritten
    sample_depth(depth_.view(), camera_, T_depth_colour, {&f, 1});
    return f.depth_m;
  }
  void fill(int x0, int y0, int x1, int y1, double z_m) {
    for (int y = y0; y < y1; ++y) std::fill(depth_.view().row(y) + x0, depth_.view().row(y) + x1, raw(z_m));
  }
};

TEST_F(DepthSampling, AFlatWallIsRead) {
  EXPECT_NEAR(at(300, 200), 2, 1e-6);
}

TEST_F(DepthSampling, AnEdgeTakesTheNearerSurface) {
  fill(320, 0, 640, 480, 1.2);
  // On either side of the edge, one pixel away, two columns or one belong to the nearer surface.
  EXPECT_NEAR(at(319, 200), 1.2, 1e-4);
  EXPECT_NEAR(at(320, 200), 1.2, 1e-4);
  EXPECT_NEAR(at(317, 200), 2, 1e-4);
  EXPECT_NEAR(at(323, 200), 1.2, 1e-4);
}

TEST_F(DepthSampling, ASlantedSurfaceIsNoEdge) {
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) depth_.view().at(x, y) = raw(1 + 0.004 * x);
  }
  EXPECT_NEAR(at(300, 200), 2.2, 0.001);
}

TEST_F(DepthSampling, OneStrayReadingIsNoSurface) {
  depth_.view().at(301, 201) = raw(0.9);
  EXPECT_EQ(at(300, 200), 0);
}

TEST_F(DepthSampling, HolesGiveNothing) {
  fill(280, 180, 320, 220, 0);
  EXPECT_EQ(at(300, 200), 0);
  // Three readings of nine are too few, four are enough.
  for (int i = 0; i < 3; ++i) depth_.view().at(299 + i, 199) = raw(2);
  EXPECT_EQ(at(300, 200), 0);
  depth_.view().at(299, 200) = raw(2);
  EXPECT_NEAR(at(300, 200), 2, 1e-6);
}

TEST_F(DepthSampling, UntrustedRangesAreHoles) {
  fill(0, 0, 640, 480, 0.1);
  EXPECT_EQ(at(300, 200), 0);
  fill(0, 0, 640, 480, 12);
  EXPECT_EQ(at(300, 200), 0);
}

TEST_F(DepthSampling, NothingAtTheBorderOrBeyond) {
  for (const auto& [x, y] :
       {std::pair{0.0, 200.0}, {639.0, 200.0}, {300.0, 0.0}, {300.0, 479.0}, {-5.0, 200.0}, {300.0, 600.0}}) {
    EXPECT_EQ(at(x, y), 0) << x << ", " << y;
  }
  EXPECT_NEAR(at(1, 1), 2, 1e-6);
  EXPECT_NEAR(at(638, 478), 2, 1e-6);
}

/// The camera turns between the two exposures: the corner is elsewhere in the depth picture.
TEST_F(DepthSampling, FollowsATurningCamera) {
  fill(400, 0, 640, 480, 1.5);
  // A point of the near surface at column 420 of the depth picture was at column 380 of the colour picture.
  const double turn = std::atan((420 - camera_.cx) / camera_.fx) - std::atan((380 - camera_.cx) / camera_.fx);
  const Pose T_depth_colour{exp_so3({0, turn, 0}), {}};
  // Turning keeps the range, not the depth.
  const double shrink = std::cos(std::atan((380 - camera_.cx) / camera_.fx)) /
                        std::cos(std::atan((420 - camera_.cx) / camera_.fx));
  EXPECT_NEAR(at(380, camera_.cy, T_depth_colour), 1.5 * shrink, 1e-4);
  EXPECT_NEAR(at(380, camera_.cy), 2, 1e-4) << "without the turn it is the far surface";
  EXPECT_GT(at(420, camera_.cy, inverse(T_depth_colour)), 1.9);
}

/// The camera moves towards the wall between colour and depth: the depth at the colour stamp is larger.
TEST_F(DepthSampling, GivesTheDepthAtTheColourStamp) {
  const Pose T_depth_colour{Mat3{}, {0, 0, -0.05}};
  EXPECT_NEAR(at(300, 200, T_depth_colour), 2.05, 1e-4);
}

TEST_F(DepthSampling, HonoursTheLens) {
  camera_.k1 = 0.26;
  camera_.k2 = -0.95;
  camera_.k3 = 1.16;
  fill(40, 30, 43, 33, 1.1);  // 3x3 around (41, 31)
  EXPECT_NEAR(at(41, 31), 1.1, 1e-4);
}

TEST_F(DepthSampling, WildTurnsGiveNothingAndNeverNonsense) {
  for (const Vec3 turn :
       {Vec3{0, 1.5707963, 0}, {0, 1.5707963267948966, 0}, {1.5707963267948966, 0, 0}, {0, 3.14159, 0}}) {
    for (double x = 10; x < 640; x += 0.5) {
      const double z = at(x, 200, {exp_so3(turn), {}});
      ASSERT_TRUE(std::isfinite(z));
    }
  }
  // So far out that a whole number of 32 bits comes back into the picture.
  const double tangent = (4294967296.0 + 300 - camera_.cx) / camera_.fx;
  EXPECT_EQ(at(camera_.cx, 200, {exp_so3({0, std::atan(tangent), 0}), {}}), 0);
  camera_.k3 = 1e3;
  EXPECT_EQ(at(319.5, 239.5, {exp_so3({0, 1.5707963267948, 0}), {}}), 0);
}

}  // namespace
}  // namespace stillmap
