// SPDX-License-Identifier: Apache-2.0
#include "track/window_adjuster.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "core/random.h"
#include "scene.h"

namespace stillmap {
namespace {

/// A camera that steps sideways past a cloud of points, every number known.
class WindowAdjusterTest : public testing::Test {
 protected:
  static constexpr int kPoints = 200;
  Config config_ = test::synthetic_config();
  const CameraModel& camera_ = config_.camera;
  Arena arena_{std::size_t{4} << 20};
  AdjustmentWindow window_{arena_};
  WindowAdjuster adjuster_{arena_, config_.camera};
  Random random_{5};
  std::vector<Pose> true_views_;
  std::vector<Vec3> true_points_;

  double noise(double size) { return size * (2 * random_.uniform() - 1); }
  Vec3 noise3(double size) { return {noise(size), noise(size), noise(size)}; }

  /// The newest view first; the last `fixed` ones hold the window.
  void make(int views, int fixed, double depth_share = 1) {
    for (int v = 0; v < views; ++v) {
      true_views_.push_back(inverse(Pose{exp_so3({0.01 * v, -0.02 * v, 0.03 * v}), {0.1 * v, 0.02 * v, 0}}));
      ASSERT_TRUE(
          window_.views.try_push_back({static_cast<std::uint32_t>(v + 1), static_cast<std::uint16_t>(v),
                                       v >= views - fixed, true_views_.back()}));
    }
    for (int i = 0; i < kPoints; ++i) {
      true_points_.push_back({noise(1.2), noise(0.8), 2.5 + noise(1)});
      ASSERT_TRUE(
          window_.points.try_push_back({{i, static_cast<std::uint32_t>(i + 1)}, true_points_.back()}));
      for (int v = 0; v < views; ++v) {
        const Vec3 p = true_views_[static_cast<std::size_t>(v)] * true_points_.back();
        const bool has_depth = i < depth_share * kPoints;
        ASSERT_TRUE(window_.observations.try_push_back(
            {static_cast<std::uint16_t>(v), static_cast<std::uint16_t>(i), static_cast<float>(p.x / p.z),
             static_cast<float>(p.y / p.z), 1, has_depth ? static_cast<float>(p.z) : 0, 0.01F}));
      }
    }
  }
  void disturb(double size) {
    for (WindowView& view : window_.views) {
      if (!view.fixed) view.T_camera_odom = Pose{exp_so3(noise3(size)), noise3(size)} * view.T_camera_odom;
    }
    for (WindowPoint& point : window_.points) point.p_odom = point.p_odom + noise3(size);
  }
  double worst_view_error() const {
    double worst = 0;
    for (std::size_t v = 0; v < window_.views.size(); ++v) {
      const Pose off = window_.views[v].T_camera_odom * inverse(true_views_[v]);
      worst = std::max({worst, norm(off.t), norm(log_so3(off.R))});
    }
    return worst;
  }
  double worst_point_error() const {
    double worst = 0;
    for (std::size_t i = 0; i < window_.points.size(); ++i)
      worst = std::max(worst, norm(window_.points[i].p_odom - true_points_[i]));
    return worst;
  }
};

TEST_F(WindowAdjusterTest, FindsPosesAndPointsThatFitTheirObservations) {
  make(8, 1);
  disturb(0.01);
  ASSERT_GT(worst_view_error(), 5e-3);
  adjuster_.adjust(window_);
  // Steps that are right to second order get from 1e-2 to the rounding of the float observations.
  EXPECT_LT(worst_view_error(), 2e-5);
  EXPECT_LT(worst_point_error(), 1e-4);
  EXPECT_LT(window_.cost_after, 1e-3 * window_.cost_before);
}

TEST_F(WindowAdjusterTest, DoesItWithFewDepths) {
  make(8, 2, 0.1);
  disturb(0.01);
  adjuster_.adjust(window_);
  EXPECT_LT(worst_view_error(), 1e-3);
}

TEST_F(WindowAdjusterTest, FixedViewsStay) {
  make(5, 2);
  disturb(0.01);
  const WindowView before = window_.views[4];
  adjuster_.adjust(window_);
  EXPECT_EQ(before.T_camera_odom.t.x, window_.views[4].T_camera_odom.t.x);
  EXPECT_EQ(before.T_camera_odom.R.m, window_.views[4].T_camera_odom.R.m);
}

TEST_F(WindowAdjusterTest, WrongMatchesHaveLittleSay) {
  make(8, 1);
  disturb(0.005);
  for (std::size_t i = 0; i < window_.observations.size(); i += 20) window_.observations[i].ray_x += 0.2F;
  adjuster_.adjust(window_);
  EXPECT_LT(worst_view_error(), 5e-3);
}

TEST_F(WindowAdjusterTest, NeverEndsWorseThanItBegan) {
  for (const double size : {0.0, 0.03, 0.3, 3.0}) {
    window_.views.clear();
    window_.points.clear();
    window_.observations.clear();
    true_views_.clear();
    true_points_.clear();
    make(4, 1);
    disturb(size);
    adjuster_.adjust(window_);
    EXPECT_LE(window_.cost_after, window_.cost_before) << size;
    for (const WindowView& view : window_.views) EXPECT_TRUE(is_finite(view.T_camera_odom)) << size;
  }
}

TEST_F(WindowAdjusterTest, LeavesAWindowThatSaysNothingAsItIs) {
  make(3, 1);
  window_.observations.clear();
  adjuster_.adjust(window_);
  EXPECT_LT(worst_view_error(), 1e-15);
  EXPECT_EQ(worst_point_error(), 0);
}

TEST_F(WindowAdjusterTest, ANumberThatIsNoneDoesNotSpread) {
  make(4, 1);
  disturb(0.01);
  window_.observations[7].ray_x = std::numeric_limits<float>::quiet_NaN();
  adjuster_.adjust(window_);
  for (const WindowView& view : window_.views) EXPECT_TRUE(is_finite(view.T_camera_odom));
}

}  // namespace
}  // namespace stillmap
