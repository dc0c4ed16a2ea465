// SPDX-License-Identifier: Apache-2.0
#include "core/geometry.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

namespace stillmap {
namespace {

constexpr double kPi = std::numbers::pi;

double distance(const Mat3& a, const Mat3& b) {
  double worst = 0;
  for (std::size_t i = 0; i < 9; ++i) worst = std::max(worst, std::abs(a.m[i] - b.m[i]));
  return worst;
}
double distance(Vec3 a, Vec3 b) {
  return norm(a - b);
}

std::vector<Vec3> axes() {
  std::vector<Vec3> out;
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        const Vec3 v{x + 0.1 * y, y + 0.01 * z, 1.0 * z};
        if (x != 0 || y != 0 || z != 0) out.push_back((1 / norm(v)) * v);
      }
    }
  }
  return out;
}

TEST(Geometry, ExpTurnsByTheRightHand) {
  EXPECT_LT(distance(exp_so3({0, 0, kPi / 2}) * Vec3{1, 0, 0}, {0, 1, 0}), 1e-15);
  EXPECT_LT(distance(exp_so3({kPi / 2, 0, 0}) * Vec3{0, 1, 0}, {0, 0, 1}), 1e-15);
  EXPECT_LT(distance(exp_so3({0, kPi / 2, 0}) * Vec3{0, 0, 1}, {1, 0, 0}), 1e-15);
}

TEST(Geometry, LogTurnsExpAroundForEveryAngleUpToPi) {
  for (const Vec3& axis : axes()) {
    for (const double angle : {0.0, 1e-300, 1e-12, 1e-9, 2e-9, 1e-6, 0.1, 1.0, kPi / 2, 2.0, 3.0, kPi - 1e-3,
                               kPi - 1e-6, kPi - 1e-9, kPi - 1e-12}) {
      const Vec3 v = angle * axis;
      EXPECT_LT(distance(log_so3(exp_so3(v)), v), 1e-12 + 1e-9 * angle) << angle;
    }
  }
}

TEST(Geometry, AtPiEitherAxisIsRight) {
  for (const Vec3& axis : axes()) {
    const Mat3 R = exp_so3(kPi * axis);
    const Vec3 v = log_so3(R);
    EXPECT_NEAR(norm(v), kPi, 1e-12);
    EXPECT_LT(distance(exp_so3(v), R), 1e-12);
  }
}

TEST(Geometry, BeyondPiTheShorterWayComesBack) {
  const Vec3 v = log_so3(exp_so3({0, 0, kPi + 0.5}));
  EXPECT_LT(distance(v, {0, 0, -(kPi - 0.5)}), 1e-12);
}

TEST(Geometry, ExpAgreesWithRodrigues) {
  for (const Vec3& a : axes()) {
    const double s = std::sin(0.7), c = std::cos(0.7);
    const Vec3 p{0.3, -2, 5};
    const Vec3 wanted = c * p + s * cross(a, p) + ((1 - c) * dot(a, p)) * a;
    EXPECT_LT(distance(exp_so3(0.7 * a) * p, wanted), 1e-14);
  }
}

TEST(Geometry, QuaternionRoundTripInEveryBranch) {
  // Near pi about each axis, w is nearly 0 and another component leads; the signs must come out together.
  std::vector<Quaternion> cases;
  for (const double small : {0.0, 1e-12, 1e-6, 0.1}) {
    for (const double sign : {-1.0, 1.0}) {
      cases.push_back({small, sign, 0.2, -0.1});
      cases.push_back({small, 0.2, sign, -0.3});
      cases.push_back({small, -0.1, 0.4, sign});
      cases.push_back({1, sign * small, -small, 0.3 * small});
    }
  }
  for (const Quaternion& q : cases) {
    const Mat3 R = rotation_from(q);
    const Quaternion back = quaternion_from(R);
    EXPECT_NEAR(back.w * back.w + back.x * back.x + back.y * back.y + back.z * back.z, 1, 1e-15);
    EXPECT_GE(back.w, 0);
    EXPECT_LT(distance(rotation_from(back), R), 1e-14);
    const double length = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    const double same = (q.w * back.w + q.x * back.x + q.y * back.y + q.z * back.z) / length;
    EXPECT_NEAR(std::abs(same), 1, 1e-14);
  }
}

TEST(Geometry, RotationFromNeedsNoUnitLength) {
  EXPECT_LT(distance(rotation_from({2, 0.2, -0.4, 0.6}), rotation_from({1, 0.1, -0.2, 0.3})), 1e-15);
  EXPECT_LT(distance(rotation_from({-1, -0.1, 0.2, -0.3}), rotation_from({1, 0.1, -0.2, 0.3})), 1e-15);
}

TEST(Geometry, PosesComposeAndInvert) {
  const Pose T_a_b{exp_so3({0.1, 2, -0.5}), {1, 2, 3}}, T_b_c{exp_so3({-1, 0.3, 0.2}), {-4, 0, 1}};
  const Vec3 p_c{0.5, -6, 7};
  EXPECT_LT(distance((T_a_b * T_b_c) * p_c, T_a_b * (T_b_c * p_c)), 1e-14);
  EXPECT_LT(distance(inverse(T_a_b) * (T_a_b * p_c), p_c), 1e-14);
}

TEST(Geometry, InterpolationGoesTheShortWayAndBeyond) {
  const Pose a{exp_so3({0, 0, 3}), {0, 0, 0}}, b{exp_so3({0, 0, -3}), {2, 0, -4}};
  const Pose half = interpolate(a, b, 0.5);
  EXPECT_LT(distance(half.R, exp_so3({0, 0, kPi})), 1e-12) << "over pi, not back over 0";
  EXPECT_LT(distance(half.t, {1, 0, -2}), 1e-15);
  EXPECT_LT(distance(interpolate(a, b, 0).R, a.R), 1e-15);
  EXPECT_LT(distance(interpolate(a, b, 1).R, b.R), 1e-12);
  const double step = 2 * kPi - 6;
  EXPECT_LT(distance(interpolate(a, b, 2).R, exp_so3({0, 0, -3 + step})), 1e-12);
  EXPECT_LT(distance(interpolate(a, b, 2).t, {4, 0, -8}), 1e-15);
}

TEST(Geometry, OrthonormalizedUndoesRounding) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> noise(-1e-6, 1e-6);
  for (const Vec3& axis : axes()) {
    Mat3 R = exp_so3(3.1 * axis);
    const Mat3 before = R;
    for (double& v : R.m) v += noise(random);
    const Mat3 fixed = orthonormalized(R);
    EXPECT_LT(distance(fixed * transposed(fixed), Mat3{}), 1e-15);
    EXPECT_LT(distance(fixed, before), 5e-6);
  }
}

TEST(Geometry, FiniteLooksAtEveryNumber) {
  EXPECT_TRUE(is_finite(Pose{}));
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (std::size_t i = 0; i < 9; ++i) {
      Pose T;
      T.R.m[i] = bad;
      EXPECT_FALSE(is_finite(T));
    }
    EXPECT_FALSE(is_finite({{}, {bad, 0, 0}}));
    EXPECT_FALSE(is_finite({{}, {0, bad, 0}}));
    EXPECT_FALSE(is_finite({{}, {0, 0, bad}}));
  }
}

}  // namespace
}  // namespace stillmap
