// SPDX-License-Identifier: Apache-2.0
#include "core/absolute_orientation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "core/random.h"

namespace stillmap {
namespace {

const Pose kMotion{exp_so3({0.7, -1.2, 2.0}), {0.4, -3, 1.5}};

double angle_between(const Pose& a, const Pose& b) {
  return norm(log_so3(transposed(a.R) * b.R));
}

/// Each coordinate evenly between -most and most.
Vec3 noise(Random& random, double most) {
  const auto one = [&] { return most * (2 * random.uniform() - 1); };
  const double x = one(), y = one(), z = one();
  return {x, y, z};
}

std::vector<Vec3> moved(const std::vector<Vec3>& from) {
  std::vector<Vec3> to;
  for (const Vec3& p : from) to.push_back(kMotion * p);
  return to;
}

TEST(AbsoluteOrientation, ThreePointsAreEnoughAndExact) {
  const std::vector<Vec3> from{{0, 0, 1}, {1, 0, 2}, {0.3, 0.8, 1.5}};
  const auto [T, unique] = absolute_orientation(from, moved(from));
  ASSERT_TRUE(unique);
  EXPECT_LT(norm(T.t - kMotion.t), 1e-9);
  EXPECT_LT(angle_between(T, kMotion), 1e-8);
}

TEST(AbsoluteOrientation, HalfATurnIsExactToo) {
  for (const Vec3 turn :
       {Vec3{3.14159265358979, 0, 0}, {0, 3.14159265358979, 0}, {0, 0, 3.14159265358979}, {0, 0, 0}}) {
    const Pose T_truth{exp_so3(turn), {1, 2, 3}};
    std::vector<Vec3> from{{0, 0, 1}, {1, 0, 2}, {0.3, 0.8, 1.5}, {-1, 0.2, 0.4}}, to;
    for (const Vec3& p : from) to.push_back(T_truth * p);
    const auto [T, unique] = absolute_orientation(from, to);
    ASSERT_TRUE(unique);
    for (std::size_t i = 0; i < from.size(); ++i) EXPECT_LT(norm(T * from[i] - to[i]), 1e-8);
  }
}

TEST(AbsoluteOrientation, ManyNoisyPointsAverage) {
  Random random(3);
  std::vector<Vec3> from(500), to;
  for (Vec3& p : from) p = noise(random, 1);
  for (const Vec3& p : moved(from)) to.push_back(p + noise(random, 0.1));
  const auto [T, unique] = absolute_orientation(from, to);
  ASSERT_TRUE(unique);
  EXPECT_LT(norm(T.t - kMotion.t), 4 * 0.05 / std::sqrt(500.0) * 2);
  EXPECT_LT(angle_between(T, kMotion), 0.01);
}

/// A mirror image has no rotation that fits; the answer must be a rotation all the same.
TEST(AbsoluteOrientation, NeverAMirror) {
  const std::vector<Vec3> from{{0, 0, 1}, {1, 0, 2}, {0.3, 0.8, 1.5}, {-1, 0.2, 0.4}};
  std::vector<Vec3> to;
  for (const Vec3& p : from) to.push_back({-p.x, p.y, p.z});
  const auto [T, unique] = absolute_orientation(from, to);
  ASSERT_TRUE(unique);
  const Mat3& R = T.R;
  const double det =
      dot(cross({R(0, 0), R(1, 0), R(2, 0)}, {R(0, 1), R(1, 1), R(2, 1)}), {R(0, 2), R(1, 2), R(2, 2)});
  EXPECT_NEAR(det, 1, 1e-9);
}

TEST(AbsoluteOrientation, SaysWhereTheRotationIsOpen) {
  const std::vector<Vec3> two{{0, 0, 1}, {1, 0, 2}}, same(5, Vec3{1, 2, 3});
  std::vector<Vec3> line;
  for (int i = 0; i < 6; ++i) line.push_back({0.3 * i, 1 - 0.2 * i, 2 + 0.1 * i});
  EXPECT_FALSE(absolute_orientation({}, {}).unique);
  EXPECT_FALSE(absolute_orientation(two, moved(two)).unique);
  EXPECT_FALSE(absolute_orientation(same, moved(same)).unique);
  EXPECT_FALSE(absolute_orientation(line, moved(two)).unique) << "not as many";
  const auto [T, unique] = absolute_orientation(line, moved(line));
  EXPECT_FALSE(unique);
  for (const Vec3& p : line) EXPECT_LT(norm(T * p - kMotion * p), 1e-9) << "one of those that fit";
}

}  // namespace
}  // namespace stillmap
