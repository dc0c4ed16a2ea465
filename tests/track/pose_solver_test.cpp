// SPDX-License-Identifier: Apache-2.0
#include "track/pose_solver.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "scene.h"

namespace stillmap {
namespace {

using test::angle_between;
using test::gaussian;

const CameraModel kCamera = synthetic::SyntheticLog::camera();
const Pose kTruth{exp_so3({0.2, -0.4, 0.1}), {0.3, -0.2, 0.5}};

struct Noise {
  double px = 0, depth_sigmas = 0;
};

/// Points all over the picture, 1 to 4 m away, seen from kTruth; every third without depth.
std::vector<PoseObservation> observations_of(std::size_t count, std::uint64_t seed, Noise noise = {}) {
  Random random(seed);
  std::vector<PoseObservation> all(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double z = 1 + 3 * random.uniform();
    const Vec3 p_camera{(random.uniform() - 0.5) * 1.1 * z, (random.uniform() - 0.5) * 0.85 * z, z};
    PoseObservation& o = all[i];
    o.p_world = inverse(kTruth) * p_camera;
    o.ray_x = p_camera.x / z + noise.px * gaussian(random) / kCamera.fx;
    o.ray_y = p_camera.y / z + noise.px * gaussian(random) / kCamera.fy;
    o.sigma_px = 1;
    if (i % 3 == 0) continue;
    o.sigma_depth_m = kCamera.depth_sigma_m(z);
    o.depth_m = z + noise.depth_sigmas * o.sigma_depth_m * gaussian(random);
  }
  return all;
}

Pose disturbed(double angle, double distance) {
  return Pose{exp_so3({angle, -angle / 2, angle / 3}), {distance, distance / 2, -distance}} * kTruth;
}

/// Half the sum of squared whitened residuals of the inliers, from the header's definition alone.
double cost(const std::vector<PoseObservation>& all, const Pose& T_camera_world) {
  double sum = 0;
  for (const PoseObservation& o : all) {
    if (!o.inlier) continue;
    const Vec3 p = T_camera_world * o.p_world;
    const double u = kCamera.fx * (p.x / p.z - o.ray_x) / o.sigma_px,
                 v = kCamera.fy * (p.y / p.z - o.ray_y) / o.sigma_px;
    const double z = o.depth_m > 0 ? (p.z - o.depth_m) / o.sigma_depth_m : 0;
    sum += o.weight * (u * u + v * v + z * z) / 2;
  }
  return sum;
}

Pose nudged(const Pose& T, int k, double step) {
  std::array<double, 6> d{};
  d[static_cast<std::size_t>(k)] = step;
  return Pose{exp_so3({d[0], d[1], d[2]}), {d[3], d[4], d[5]}} * T;
}

bool all_finite(const PoseEstimate& e) {
  bool finite = is_finite(e.T_camera_world) && std::isfinite(e.rms_px);
  for (const double c : e.covariance) finite &= std::isfinite(c);
  return finite;
}

TEST(PoseSolver, RecoversThePoseExactly) {
  for (const double angle : {0.0, 0.02, 0.1, 0.3}) {
    std::vector<PoseObservation> all = observations_of(60, 1);
    const PoseEstimate e = solve_pose(all, kCamera, disturbed(angle, angle));
    ASSERT_TRUE(e.converged) << angle;
    EXPECT_EQ(e.inliers, 60);
    EXPECT_LT(norm(e.T_camera_world.t - kTruth.t), 1e-9) << angle;
    EXPECT_LT(angle_between(e.T_camera_world, kTruth), 1e-9) << angle;
    EXPECT_LT(e.rms_px, 1e-6);
  }
}

TEST(PoseSolver, RecoversThePoseFromPixelsAlone) {
  std::vector<PoseObservation> all = observations_of(60, 1);
  for (PoseObservation& o : all) o.depth_m = 0;
  const PoseEstimate e = solve_pose(all, kCamera, disturbed(0.05, 0.05));
  ASSERT_TRUE(e.converged);
  EXPECT_LT(norm(e.T_camera_world.t - kTruth.t), 1e-8);
}

/// The numerical gradient vanishes where the solver stops: every Jacobian row is right, or it would stop
/// elsewhere.
TEST(PoseSolver, StopsWhereTheNumericalGradientVanishes) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    std::vector<PoseObservation> all = observations_of(80, seed, {0.4, 0.4});
    for (std::size_t i = 0; i < all.size(); ++i) all[i].weight = i % 4 == 0 ? 0.3 : 1;
    const PoseEstimate e = solve_pose(all, kCamera, disturbed(0.03, 0.03));
    ASSERT_TRUE(e.converged);
    ASSERT_EQ(e.inliers, 80) << "outliers would make the cost another one";
    const double at = cost(all, e.T_camera_world);
    for (int k = 0; k < 6; ++k) {
      constexpr double kStep = 1e-5;
      const double up = cost(all, nudged(e.T_camera_world, k, kStep)),
                   down = cost(all, nudged(e.T_camera_world, k, -kStep));
      const double gradient = (up - down) / (2 * kStep), curvature = (up - 2 * at + down) / (kStep * kStep);
      EXPECT_LT(std::abs(gradient), 1e-4 * std::sqrt(curvature)) << "parameter " << k;
      EXPECT_GT(curvature, 0);
    }
  }
}

/// The covariance's inverse is the Hessian of the cost, up to terms of second order in the (small) residuals.
TEST(PoseSolver, CovarianceIsTheInverseOfTheNumericalHessian) {
  std::vector<PoseObservation> all = observations_of(80, 3);
  const PoseEstimate e = solve_pose(all, kCamera, disturbed(0.03, 0.03));
  ASSERT_TRUE(e.converged);
  constexpr double kStep = 1e-4;
  for (int r = 0; r < 6; ++r) {
    for (int c = 0; c < 6; ++c) {
      double product = 0;  // (covariance * Hessian)(r, c)
      for (int k = 0; k < 6; ++k) {
        const auto f = [&](double a, double b) {
          return cost(all, nudged(nudged(e.T_camera_world, k, a), c, b));
        };
        const double hessian =
            (f(kStep, kStep) - f(kStep, -kStep) - f(-kStep, kStep) + f(-kStep, -kStep)) / (4 * kStep * kStep);
        product += e.covariance[static_cast<std::size_t>(6 * r + k)] * hessian;
      }
      EXPECT_NEAR(product, r == c ? 1 : 0, 0.05) << r << ", " << c;
    }
  }
}

TEST(PoseSolver, CovarianceMatchesRepeatedMeasurements) {
  constexpr int kTrials = 400;
  std::array<double, 6> squared{};
  std::array<double, 36> stated{};
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<PoseObservation> all = observations_of(60, 1000 + static_cast<std::uint64_t>(trial), {1, 1});
    const PoseEstimate e = solve_pose(all, kCamera, kTruth);
    ASSERT_TRUE(e.converged);
    const Pose error = e.T_camera_world * inverse(kTruth);
    const Vec3 w = log_so3(error.R);
    const std::array<double, 6> d{w.x, w.y, w.z, error.t.x, error.t.y, error.t.z};
    for (std::size_t k = 0; k < 6; ++k) squared[k] += d[k] * d[k] / kTrials;
    for (std::size_t k = 0; k < 36; ++k) stated[k] += e.covariance[k] / kTrials;
  }
  for (std::size_t k = 0; k < 6; ++k) {
    const double ratio = std::sqrt(squared[k] / stated[7 * k]);
    EXPECT_GT(ratio, 0.8) << "parameter " << k;
    EXPECT_LT(ratio, 1.4) << "parameter " << k;
  }
}

/// Under the stated noise one observation in twenty is left out, with depth and without.
TEST(PoseSolver, TestsAtNinetyFivePercent) {
  for (const bool with_depth : {true, false}) {
    double kept = 0;
    constexpr int kTrials = 100;
    for (std::uint64_t trial = 0; trial < kTrials; ++trial) {
      std::vector<PoseObservation> all = observations_of(100, 5000 + trial, {1, 1});
      for (std::size_t i = 0; i < all.size(); ++i) {
        if (!with_depth) all[i].depth_m = 0;
        if (with_depth && i % 3 == 0) all[i].weight = 0;  // those without depth are not what is counted here
      }
      const PoseEstimate e = solve_pose(all, kCamera, kTruth);
      ASSERT_TRUE(e.converged);
      kept += e.inliers / (with_depth ? 66.0 : 100.0) / kTrials;
    }
    EXPECT_NEAR(kept, 0.95, 0.02) << "depth " << with_depth;
  }
}

TEST(PoseSolver, RejectsOutliersAndOnlyThem) {
  std::vector<PoseObservation> all = observations_of(100, 5, {0.3, 0.3});
  Random random(6);
  for (std::size_t i = 0; i < 30; ++i) {
    all[i].ray_x += (random.uniform() < 0.5 ? 1 : -1) * (15 + 60 * random.uniform()) / kCamera.fx;
    all[i].ray_y += 40 * (random.uniform() - 0.5) / kCamera.fy;
  }
  const PoseEstimate e = solve_pose(all, kCamera, disturbed(0.01, 0.02));
  ASSERT_TRUE(e.converged);
  for (std::size_t i = 0; i < 30; ++i) EXPECT_FALSE(all[i].inlier) << i;
  EXPECT_GE(e.inliers, 66);
  EXPECT_LE(e.inliers, 70);
  EXPECT_LT(norm(e.T_camera_world.t - kTruth.t), 0.005);
  EXPECT_LT(e.rms_px, 0.6);
}

TEST(PoseSolver, AWrongDepthMakesAnOutlier) {
  std::vector<PoseObservation> all = observations_of(60, 5);
  ASSERT_GT(all[1].depth_m, 0);
  all[1].depth_m += 10 * all[1].sigma_depth_m;
  const PoseEstimate e = solve_pose(all, kCamera, disturbed(0.01, 0.01));
  ASSERT_TRUE(e.converged);
  EXPECT_FALSE(all[1].inlier);
  EXPECT_EQ(e.inliers, 59);
  EXPECT_EQ(e.observed, 60);
  EXPECT_LT(norm(e.T_camera_world.t - kTruth.t), 1e-6);
}

TEST(PoseSolver, WeightZeroIsOnlyTested) {
  std::vector<PoseObservation> all = observations_of(40, 7);
  for (std::size_t i = 0; i < 10; ++i) all[i].weight = 0;
  for (std::size_t i = 0; i < 5; ++i) all[i].ray_x += 0.2;  // some of them are far off
  const PoseEstimate e = solve_pose(all, kCamera, disturbed(0.02, 0.02));
  ASSERT_TRUE(e.converged);
  EXPECT_EQ(e.inliers, 30) << "they do not count";
  EXPECT_EQ(e.observed, 30);
  EXPECT_LT(norm(e.T_camera_world.t - kTruth.t), 1e-9) << "they do not pull";
  for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(all[i].inlier, i >= 5) << i;
}

TEST(PoseSolver, AnInitialOutlierThatFitsComesBack) {
  std::vector<PoseObservation> all = observations_of(40, 7);
  all[3].inlier = false;
  ASSERT_TRUE(solve_pose(all, kCamera, disturbed(0.02, 0.02)).converged);
  EXPECT_TRUE(all[3].inlier);
}

TEST(PoseSolver, PointsBehindTheCameraAreOutliers) {
  std::vector<PoseObservation> all = observations_of(40, 7);
  for (std::size_t i = 0; i < 5; ++i) {
    Vec3 p = kTruth * all[i].p_world;
    p.z = i == 0 ? 0 : -p.z;
    all[i].p_world = inverse(kTruth) * p;
  }
  const PoseEstimate e = solve_pose(all, kCamera, disturbed(0.02, 0.02));
  ASSERT_TRUE(e.converged);
  EXPECT_EQ(e.inliers, 35);
  for (std::size_t i = 0; i < 5; ++i) EXPECT_FALSE(all[i].inlier);
  EXPECT_TRUE(all_finite(e));
}

/// What cannot decide a pose is refused, and the initial pose comes back untouched.
void expect_refused(std::vector<PoseObservation> all, const char* what) {
  const Pose initial = disturbed(0.02, 0.02);
  const PoseEstimate e = solve_pose(all, kCamera, initial);
  EXPECT_FALSE(e.converged) << what;
  EXPECT_EQ(e.T_camera_world.R.m, initial.R.m) << what;
  EXPECT_EQ(norm(e.T_camera_world.t - initial.t), 0) << what;
  EXPECT_TRUE(all_finite(e)) << what;
}

TEST(PoseSolver, TooFewObservationsAreRefused) {
  expect_refused({}, "none");
  expect_refused(observations_of(5, 1), "five");
  std::vector<PoseObservation> weightless = observations_of(40, 1);
  for (PoseObservation& o : weightless) o.weight = 0;
  expect_refused(weightless, "none with weight");
}

TEST(PoseSolver, DegenerateObservationsAreRefused) {
  std::vector<PoseObservation> same = observations_of(50, 1);
  for (PoseObservation& o : same) o = same[1];
  expect_refused(same, "one point, many times");
  for (PoseObservation& o : same) o.depth_m = 0;
  expect_refused(same, "one point without depth");

  // On a line through space the turn about the line is open, however many points and depths.
  for (const bool with_depth : {true, false}) {
    std::vector<PoseObservation> line = observations_of(50, 1);
    for (std::size_t i = 0; i < line.size(); ++i) {
      const double s = static_cast<double>(i) / 25 - 1;
      const Vec3 p{0.3 * s, 0.2 * s, 2 + 0.5 * s};
      line[i].p_world = inverse(kTruth) * p;
      line[i].ray_x = p.x / p.z;
      line[i].ray_y = p.y / p.z;
      line[i].depth_m = with_depth ? p.z : 0;
      line[i].sigma_depth_m = 0.01;
    }
    expect_refused(line, with_depth ? "a line with depth" : "a line");
  }
}

TEST(PoseSolver, NonsenseIsRefusedOrIgnoredButNeverNaN) {
  const double nan = std::nan(""), inf = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, inf, -inf, 1e300}) {
    for (int field = 0; field < 4; ++field) {
      std::vector<PoseObservation> all = observations_of(40, 1);
      PoseObservation& o = all[4];
      (field == 0 ? o.p_world.x : field == 1 ? o.p_world.z : field == 2 ? o.ray_x : o.depth_m) = bad;
      const PoseEstimate e = solve_pose(all, kCamera, disturbed(0.02, 0.02));
      EXPECT_TRUE(all_finite(e)) << "field " << field << " = " << bad;
    }
  }
  std::vector<PoseObservation> all = observations_of(40, 1);
  const PoseEstimate e = solve_pose(all, kCamera, {Mat3{{nan, 0, 0, 0, 1, 0, 0, 0, 1}}, {}});
  EXPECT_FALSE(e.converged);
}

TEST(PoseSolver, AHopelessStartIsRefusedOrRightButNeverWrong) {
  for (const double angle : {1.0, 2.0, 3.0}) {
    std::vector<PoseObservation> all = observations_of(60, 1);
    const PoseEstimate e = solve_pose(all, kCamera, disturbed(angle, 3));
    EXPECT_TRUE(all_finite(e));
    if (!e.converged || e.inliers <= 30) continue;
    EXPECT_LT(norm(e.T_camera_world.t - kTruth.t), 0.01) << angle;
  }
}

/// Matches as a guided search around `guess` makes them, of which `wrong` are of anything that lies near.
std::vector<PoseObservation> found_around(const Pose& guess, std::size_t wrong, std::uint64_t seed) {
  std::vector<PoseObservation> all = observations_of(150, seed, {0.5, 0.5});
  Random random(seed + 1);
  for (std::size_t i = 0; i < wrong; ++i) {
    PoseObservation& o = all[i];
    const Vec3 p = guess * o.p_world;
    o.ray_x = p.x / p.z + 16 * (2 * random.uniform() - 1) / kCamera.fx;
    o.ray_y = p.y / p.z + 16 * (2 * random.uniform() - 1) / kCamera.fy;
    if (o.depth_m > 0) o.depth_m = p.z * (1 + 0.1 * (2 * random.uniform() - 1));
  }
  return all;
}

TEST(PoseAmongOutliers, IsFoundWhereDescentEndsInAWrongOne) {
  const Pose guess = disturbed(0.04, 0.03);
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    std::vector<PoseObservation> all = found_around(guess, 100, seed);
    const PoseEstimate descended = solve_pose(all, kCamera, guess);
    EXPECT_GT(norm(descended.T_camera_world.t - kTruth.t), 0.02) << seed;
    all = found_around(guess, 100, seed);
    const PoseEstimate e = solve_pose_among_outliers(all, kCamera, guess, nullptr, Random(seed));
    ASSERT_TRUE(e.converged) << seed;
    EXPECT_LT(norm(e.T_camera_world.t - kTruth.t), 0.01) << seed;
    EXPECT_LT(angle_between(e.T_camera_world, kTruth), 0.005) << seed;
    EXPECT_EQ(std::ranges::count_if(all, &PoseObservation::inlier), e.inliers) << seed;
  }
}

TEST(PoseAmongOutliers, IsTheDescentsWhereMostAgree) {
  const Pose guess = disturbed(0.01, 0.01);
  std::vector<PoseObservation> all = found_around(guess, 40, 3), same = all;
  const PoseEstimate descended = solve_pose(all, kCamera, guess);
  const PoseEstimate e = solve_pose_among_outliers(same, kCamera, guess, nullptr, Random(1));
  ASSERT_TRUE(descended.converged);
  EXPECT_EQ(e.T_camera_world.R.m, descended.T_camera_world.R.m);
  EXPECT_EQ(e.inliers, descended.inliers);
}

/// Where nothing is right, what a few agree with by chance is not taken for the camera's pose, and the marks
/// of the observations are those of the answer.
TEST(PoseAmongOutliers, IsNotMadeUp) {
  const Pose guess = disturbed(0.04, 0.03), nowhere = disturbed(0.02, -0.05);
  const PosePrior prior{guess, 0.1, 0.1};
  int compared = 0;
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    std::vector<PoseObservation> all = found_around(guess, 150, seed);
    for (PoseObservation& o : observations_of(20, seed + 100)) {
      o.p_world = inverse(nowhere) * (kTruth * o.p_world);
      all.push_back(o);
    }
    std::vector<PoseObservation> same = all;
    const PoseEstimate descended = solve_pose(all, kCamera, guess, &prior);
    const PoseEstimate e = solve_pose_among_outliers(same, kCamera, guess, &prior, Random(seed));
    EXPECT_EQ(e.T_camera_world.R.m, descended.T_camera_world.R.m) << seed;
    EXPECT_EQ(e.converged, descended.converged) << seed;
    compared += e.converged;
    for (std::size_t i = 0; e.converged && i < all.size(); ++i)
      EXPECT_EQ(same[i].inlier, all[i].inlier) << seed << ", " << i;
  }
  EXPECT_GE(compared, 5);
}

TEST(PoseAmongOutliers, IsWhereTheWeightIsNotTheNumber) {
  // A mover's points agree with each other, too, and are more, but nothing trusts them.
  const Pose guess = disturbed(0.04, 0.03), mover = disturbed(0.03, -0.05);
  std::vector<PoseObservation> all = found_around(guess, 60, 5);
  std::vector<PoseObservation> moving = observations_of(200, 6);
  for (PoseObservation& o : moving) {
    o.p_world = inverse(mover) * (kTruth * o.p_world);
    o.weight = 0.1;
  }
  all.insert(all.end(), moving.begin(), moving.end());
  const PoseEstimate e = solve_pose_among_outliers(all, kCamera, guess, nullptr, Random(1));
  ASSERT_TRUE(e.converged);
  EXPECT_LT(norm(e.T_camera_world.t - kTruth.t), 0.01);
}

}  // namespace
}  // namespace stillmap
