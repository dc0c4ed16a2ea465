// SPDX-License-Identifier: Apache-2.0
#include "track/frame_alignment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "scene.h"

namespace stillmap {
namespace {

/// A painted wall two metres away with a box before it, as a camera that has moved sees it.
class FrameAlignmentTest : public testing::Test {
 protected:
  static CameraModel camera() {
    CameraModel c;
    c.width = 640, c.height = 480;
    c.fx = c.fy = 520;
    c.cx = 319.5, c.cy = 239.5;
    return c;
  }
  static double paint(double x, double y) {
    return 128 + 45 * std::sin(6 * x + 2 * y) + 35 * std::sin(9 * y - 4 * x) +
           20 * std::sin(17 * x + 5 * y * y);
  }
  void look(const Pose& T_world_camera) {
    const CameraModel c = camera();
    for (int y = 0; y < c.height; ++y) {
      for (int x = 0; x < c.width; ++x) {
        const Vec3 ray = T_world_camera.R * Vec3{(x - c.cx) / c.fx, (y - c.cy) / c.fy, 1};
        double z = (2 - T_world_camera.t.z) / ray.z;
        const Vec3 on_box = T_world_camera.t + (1.4 - T_world_camera.t.z) / ray.z * ray;
        const bool box = std::abs(on_box.x - 0.1) < 0.35 && std::abs(on_box.y) < 0.3;
        if (box) z = (1.4 - T_world_camera.t.z) / ray.z;
        const Vec3 p = T_world_camera.t + z * ray;
        const double value = paint(p.x + (box ? 5 : 0), p.y) * gain_ + offset_;
        grey_.view().at(x, y) = static_cast<std::uint8_t>(std::clamp(value, 0.0, 255.0));
        depth_.view().at(x, y) = static_cast<std::uint16_t>(std::lround(1000 * z));
      }
    }
    alignment_.take(grey_.view());
  }
  void remember(const DynamicMask& mask = DynamicMask()) { alignment_.remember(depth_.view(), mask); }
  /// Looks from the origin, then from `T_world_camera`, knowing nothing of the motion.
  Pose found_after(const Pose& T_world_camera) {
    look({});
    remember();
    look(T_world_camera);
    return inverse(alignment_.align(kStill));
  }
  static void expect_near(const Pose& found, const Pose& truth, double rad, double m) {
    EXPECT_LT(test::angle_between(found, truth), rad);
    EXPECT_LT(norm(found.t - truth.t), m);
  }

  const PosePrior kStill{{}, 0.1, 0.1};
  const Pose kJerk{exp_so3({0.03, -0.05, 0.02}), {0.03, -0.02, 0.04}};
  double gain_ = 1, offset_ = 0;
  test::Image<std::uint8_t> grey_{640, 480};
  test::Image<std::uint16_t> depth_{640, 480};
  Arena arena_{std::size_t{8} << 20};
  FrameAlignment alignment_{arena_, camera()};
};

TEST_F(FrameAlignmentTest, FollowsAJerk) {
  expect_near(found_after(kJerk), kJerk, 0.004, 0.012);
}

TEST_F(FrameAlignmentTest, ADarkerPictureIsNoMotion) {
  look({});
  remember();
  gain_ = 0.9, offset_ = -15;
  look(kJerk);
  expect_near(inverse(alignment_.align(kStill)), kJerk, 0.006, 0.02);
}

TEST_F(FrameAlignmentTest, HolesInDepthAreNoHarm) {
  look({});
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) {
      if ((x / 40 + y / 40) % 3 != 0) depth_.view().at(x, y) = 0;
    }
  }
  remember();
  look(kJerk);
  expect_near(inverse(alignment_.align(kStill)), kJerk, 0.006, 0.02);
}

TEST_F(FrameAlignmentTest, MoversHaveNoSay) {
  // All but the picture's right third has gone 6 cm to the right.
  DynamicMask mask;
  mask.rule = DynamicRule::Silhouette;
  mask.columns = 80, mask.rows = 60;
  for (int row = 0; row < 60; ++row) {
    for (int column = 0; column < 50; ++column)
      mask.cells[static_cast<std::size_t>(row * 80 + column)] = {500, 5000, Label::Dynamic, 0};
  }
  const auto found_with = [&](const DynamicMask& m) {
    look({{}, {0.06, 0, 0}});
    const test::Image<std::uint8_t> gone = grey_;
    look({});
    remember(m);
    for (int y = 0; y < 480; ++y) {
      for (int x = 0; x < 400; ++x) grey_.view().at(x, y) = gone.view().at(x, y);
    }
    alignment_.take(grey_.view());
    return inverse(alignment_.align({{}, 0.02, 0.02}));
  };
  EXPECT_GT(norm(found_with(DynamicMask()).t), 0.03);
  EXPECT_LT(norm(found_with(mask).t), 0.01);
}

TEST_F(FrameAlignmentTest, WhereNothingCanBeSaidTheMotionModelStays) {
  const PosePrior model{{exp_so3({0, 0.02, 0}), {0.01, 0, 0}}, 0.1, 0.1};
  look({});
  EXPECT_EQ(alignment_.align(model).t.x, model.T_camera_world.t.x) << "nothing is remembered";
  for (int y = 0; y < 480; ++y) std::fill_n(depth_.view().row(y), 640, std::uint16_t{0});
  remember();
  EXPECT_EQ(alignment_.align(model).t.x, model.T_camera_world.t.x) << "no depth";
  look({});
  remember();
  EXPECT_LT(norm(alignment_.align(kStill).t), 1e-3);
  alignment_.forget();
  EXPECT_EQ(alignment_.align(model).t.x, model.T_camera_world.t.x) << "forgotten";
  gain_ = 0, offset_ = 90;  // a bare wall
  look({});
  remember();
  look(kJerk);
  EXPECT_LT(norm(alignment_.align(model).t - model.T_camera_world.t), 1e-9);
  EXPECT_LT(test::angle_between(alignment_.align(model), model.T_camera_world), 1e-6);
}

TEST_F(FrameAlignmentTest, HoldsWhereMostOfThePictureAgreesAndTellsOfTheTurn) {
  const auto holds = [&](const PosePrior& prior, const DynamicMask& mask = {}) {
    alignment_.align(prior);
    return alignment_.holds(mask);
  };
  EXPECT_FALSE(alignment_.holds({})) << "nothing is aligned";
  found_after(kJerk);
  EXPECT_TRUE(holds(kStill));
  EXPECT_FALSE(holds({{exp_so3({0, 1.2, 0}), {}}, 0.1, 0.1})) << "sought where nothing of it is in view";
  EXPECT_FALSE(holds({{}, 1e-5, 1e-5})) << "who knows better needs no picture";
  DynamicMask movers;
  movers.rule = DynamicRule::Silhouette;
  movers.columns = 80, movers.rows = 60;
  movers.cells.fill({1, 60000, Label::Dynamic, 0});
  EXPECT_FALSE(holds(kStill, movers)) << "all that agrees is a mover's";
  look({exp_so3({0, 0, 1.5}), {}});
  EXPECT_FALSE(holds(kStill)) << "another picture";
  gain_ = 0, offset_ = 90;
  look({});
  remember();
  look(kJerk);
  EXPECT_FALSE(holds(kStill)) << "a bare wall agrees with everything";
  alignment_.forget();
  EXPECT_FALSE(holds(kStill));
}

TEST_F(FrameAlignmentTest, WhatTheModelIsSureOfIsKept) {
  look({});
  remember();
  look(kJerk);
  const Pose held = inverse(alignment_.align({{}, 1e-5, 1e-5}));
  EXPECT_LT(norm(held.t), 1e-3);
}

}  // namespace
}  // namespace stillmap
