// SPDX-License-Identifier: Apache-2.0
#include "track/epipolar.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "scene.h"

namespace stillmap {
namespace {

const CameraModel kCamera = synthetic::SyntheticLog::camera();

Mat3 skew(Vec3 t) {
  return {{0, -t.z, t.y, t.z, 0, -t.x, -t.y, t.x, 0}};
}
Mat3 inverse_intrinsics() {
  return {
      {1 / kCamera.fx, 0, -kCamera.cx / kCamera.fx, 0, 1 / kCamera.fy, -kCamera.cy / kCamera.fy, 0, 0, 1}};
}
/// F = K^-T [t]x R K^-1 for a camera that maps p to R p + t.
Mat3 fundamental_of(const Pose& T_second_first) {
  const Mat3 Ki = inverse_intrinsics();
  return transposed(Ki) * (skew(T_second_first.t) * (T_second_first.R * Ki));
}

const Pose kMotion{exp_so3({0.01, -0.02, 0.015}), {0.08, -0.03, 0.02}};

Correspondence seen(Vec3 p, const Pose& T_second_first = kMotion) {
  return {kCamera.project(p), kCamera.project(T_second_first * p)};
}
Vec3 anywhere(Random& random) {
  const double z = 1 + 3 * random.uniform();
  return {(random.uniform() - 0.5) * 1.1 * z, (random.uniform() - 0.5) * 0.85 * z, z};
}
std::vector<Correspondence> still_world(std::size_t count, std::uint64_t seed, double noise_px = 0) {
  Random random(seed);
  std::vector<Correspondence> all(count);
  for (Correspondence& c : all) {
    c = seen(anywhere(random));
    c.second.x += noise_px * test::gaussian(random);
    c.second.y += noise_px * test::gaussian(random);
  }
  return all;
}

TEST(EpipolarDistance, SidewaysMotionMeasuresTheOtherDirection) {
  // t = (1, 0, 0): lines are rows, so the distance is |dv| (the scale of F does not matter).
  const Mat3 along_x{{0, 0, 0, 0, 0, -0.37, 0, 0.37, 0}};
  EXPECT_NEAR(epipolar_distance(along_x, {{100, 50}, {180, 50}}), 0, 1e-12);
  EXPECT_NEAR(epipolar_distance(along_x, {{100, 50}, {180, 57.5}}), 7.5, 1e-12);
  EXPECT_NEAR(epipolar_distance(along_x, {{100, 50}, {-30, 48}}), 2, 1e-12);
  const Mat3 along_y{{0, 0, 1, 0, 0, 0, -1, 0, 0}};
  EXPECT_NEAR(epipolar_distance(along_y, {{100, 50}, {103, 90}}), 3, 1e-12);
}

TEST(EpipolarDistance, ForwardMotionMeasuresFromTheRayThroughTheEpipole) {
  // t = (0, 0, 1), pixels from the centre: the line through the centre and (30, 40); (3, -1) is 5 from it...
  // by hand: line = t x p = (-40, 30, 0); |-40 * 3 + 30 * -1| / 50 = 3.
  const Mat3 along_z{{0, -1, 0, 1, 0, 0, 0, 0, 0}};
  EXPECT_NEAR(epipolar_distance(along_z, {{30, 40}, {3, -1}}), 3, 1e-12);
}

TEST(EpipolarDistance, AStillPointHasNone) {
  const Mat3 F = fundamental_of(kMotion);
  Random random(1);
  for (int i = 0; i < 100; ++i) EXPECT_LT(epipolar_distance(F, seen(anywhere(random))), 1e-9);
}

TEST(EpipolarDistance, FirstAndSecondAreNotTheSame) {
  const Mat3 F = fundamental_of(kMotion);
  Random random(1);
  double furthest = 0;
  for (int i = 0; i < 20; ++i) {
    const Correspondence c = seen(anywhere(random));
    furthest = std::max(furthest, epipolar_distance(F, {c.second, c.first}));
  }
  EXPECT_GT(furthest, 1);
}

TEST(EpipolarDistance, InfiniteWhereThereIsNoLine) {
  EXPECT_EQ(epipolar_distance(Mat3{{0, 0, 0, 0, 0, 0, 0, 0, 0}}, {{1, 2}, {3, 4}}),
            std::numeric_limits<double>::infinity());
  // At the epipole itself every line goes.
  const Mat3 along_z{{0, -1, 0, 1, 0, 0, 0, 0, 0}};
  EXPECT_EQ(epipolar_distance(along_z, {{0, 0}, {3, 4}}), std::numeric_limits<double>::infinity());
}

TEST(Fundamental, ExactOnAStillWorld) {
  const auto all = still_world(60, 2);
  const auto F = fundamental_by_ransac(all, 1, Random(3));
  ASSERT_TRUE(F);
  Random random(77);
  for (int i = 0; i < 100; ++i)
    EXPECT_LT(epipolar_distance(*F, seen(anywhere(random))), 1e-3) << "points not used for it";
}

TEST(Fundamental, SurvivesThirtyPercentOutliers) {
  int good = 0;
  constexpr int kTrials = 100;
  for (int trial = 0; trial < kTrials; ++trial) {
    const auto seed = static_cast<std::uint64_t>(trial);
    std::vector<Correspondence> all = still_world(100, seed, 0.2);
    Random random(seed + 500);
    for (std::size_t i = 0; i < 30; ++i) all[i].second = {640 * random.uniform(), 480 * random.uniform()};
    const auto F = fundamental_by_ransac(all, 1.5, Random(seed));
    if (!F) continue;
    int near = 0;
    for (const Correspondence& c : still_world(200, seed + 1000)) near += epipolar_distance(*F, c) < 1.5;
    good += near > 170;
  }
  EXPECT_GE(good, 95);
}

TEST(Fundamental, FewerThanFifteenAreNotEnough) {
  EXPECT_FALSE(fundamental_by_ransac({}, 1, Random(1)));
  EXPECT_FALSE(fundamental_by_ransac(still_world(14, 1), 1, Random(1)));
  EXPECT_TRUE(fundamental_by_ransac(still_world(15, 1), 1, Random(1)));
}

TEST(Fundamental, FifteenAreSolvedAsWellAsSixty) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    const auto F = fundamental_by_ransac(still_world(15, seed), 1, Random(seed));
    ASSERT_TRUE(F) << seed;
    int near = 0;
    for (const Correspondence& c : still_world(200, seed + 1000)) near += epipolar_distance(*F, c) < 1;
    EXPECT_GT(near, 180) << seed;
  }
}

TEST(Fundamental, DisagreementGivesNothing) {
  Random random(4);
  std::vector<Correspondence> noise(100);
  for (Correspondence& c : noise) {
    c = {{640 * random.uniform(), 480 * random.uniform()}, {640 * random.uniform(), 480 * random.uniform()}};
  }
  EXPECT_FALSE(fundamental_by_ransac(noise, 1, Random(1)));
}

TEST(Fundamental, OnePlaceManyTimesSaysNothingAndDoesNoHarm) {
  const std::vector<Correspondence> same(50, Correspondence{{100, 100}, {104, 100}});
  EXPECT_FALSE(fundamental_by_ransac(same, 1, Random(1)));
}

TEST(Fundamental, TheSameRandomGivesTheSameAnswer) {
  const auto all = still_world(60, 2, 0.5);
  const auto a = fundamental_by_ransac(all, 1.5, Random(9)), b = fundamental_by_ransac(all, 1.5, Random(9));
  const auto c = fundamental_by_ransac(all, 1.5, Random(10));
  ASSERT_TRUE(a && b && c);
  EXPECT_EQ(a->m, b->m);
  EXPECT_NE(a->m, c->m);
}

}  // namespace
}  // namespace stillmap
