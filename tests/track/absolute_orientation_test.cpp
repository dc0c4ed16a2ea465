// SPDX-License-Identifier: Apache-2.0
#include "track/absolute_orientation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "scene.h"

namespace stillmap {
namespace {

using test::angle_between;

const Pose kMotion{exp_so3({0.7, -1.2, 2.0}), {0.4, -3, 1.5}};

std::vector<Vec3> moved(const std::vector<Vec3>& from) {
  std::vector<Vec3> to;
  for (const Vec3& p : from) to.push_back(kMotion * p);
  return to;
}

TEST(AbsoluteOrientation, ThreePointsAreEnoughAndExact) {
  const std::vector<Vec3> from{{0, 0, 1}, {1, 0, 2}, {0.3, 0.8, 1.5}};
  const auto T = absolute_orientation(from, moved(from));
  ASSERT_TRUE(T);
  EXPECT_LT(norm(T->t - kMotion.t), 1e-9);
  EXPECT_LT(angle_between(*T, kMotion), 1e-8);
}

TEST(AbsoluteOrientation, HalfATurnIsExactToo) {
  for (const Vec3 turn :
       {Vec3{3.14159265358979, 0, 0}, {0, 3.14159265358979, 0}, {0, 0, 3.14159265358979}, {0, 0, 0}}) {
    const Pose T_truth{exp_so3(turn), {1, 2, 3}};
    std::vector<Vec3> from{{0, 0, 1}, {1, 0, 2}, {0.3, 0.8, 1.5}, {-1, 0.2, 0.4}}, to;
    for (const Vec3& p : from) to.push_back(T_truth * p);
    const auto T = absolute_orientation(from, to);
    ASSERT_TRUE(T);
    for (std::size_t i = 0; i < from.size(); ++i) EXPECT_LT(norm(*T * from[i] - to[i]), 1e-8);
  }
}

TEST(AbsoluteOrientation, ManyNoisyPointsAverage) {
  Random random(3);
  std::vector<Vec3> from(500), to;
  for (Vec3& p : from) p = test::gaussian_vec(random, 1);
  for (const Vec3& p : moved(from)) to.push_back(p + test::gaussian_vec(random, 0.05));
  const auto T = absolute_orientation(from, to);
  ASSERT_TRUE(T);
  EXPECT_LT(norm(T->t - kMotion.t), 4 * 0.05 / std::sqrt(500.0) * 2);
  EXPECT_LT(angle_between(*T, kMotion), 0.01);
}

/// A mirror image has no rotation that fits; the answer must be a rotation all the same.
TEST(AbsoluteOrientation, NeverAMirror) {
  const std::vector<Vec3> from{{0, 0, 1}, {1, 0, 2}, {0.3, 0.8, 1.5}, {-1, 0.2, 0.4}};
  std::vector<Vec3> to;
  for (const Vec3& p : from) to.push_back({-p.x, p.y, p.z});
  const auto T = absolute_orientation(from, to);
  if (!T) return;
  const Mat3& R = T->R;
  const double det =
      dot(cross({R(0, 0), R(1, 0), R(2, 0)}, {R(0, 1), R(1, 1), R(2, 1)}), {R(0, 2), R(1, 2), R(2, 2)});
  EXPECT_NEAR(det, 1, 1e-9);
}

TEST(AbsoluteOrientation, UndecidedGivesNothing) {
  const std::vector<Vec3> two{{0, 0, 1}, {1, 0, 2}}, same(5, Vec3{1, 2, 3});
  std::vector<Vec3> line;
  for (int i = 0; i < 6; ++i) line.push_back({0.3 * i, 1 - 0.2 * i, 2 + 0.1 * i});
  EXPECT_FALSE(absolute_orientation({}, {}));
  EXPECT_FALSE(absolute_orientation(two, moved(two)));
  EXPECT_FALSE(absolute_orientation(same, moved(same)));
  EXPECT_FALSE(absolute_orientation(line, moved(line)));
  EXPECT_FALSE(absolute_orientation(line, moved(two))) << "not as many";
}

}  // namespace
}  // namespace stillmap
