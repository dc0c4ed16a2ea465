// SPDX-License-Identifier: Apache-2.0
#include "eval/consistency.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace stillmap {
namespace {

using Covariance = std::array<double, 36>;

constexpr Nanoseconds kStep_ns = 50'000'000;

StampedPose truth_at(int i) {
  const double s = 0.05 * i;
  return {
      i * kStep_ns,
      {exp_so3({0.7 * std::sin(1.3 * s), 0.9 * s, 0.4 * std::cos(s)}), {std::sin(s), 0.3 * s, std::cos(s)}}};
}

/// Sharp across, blunt along the view; rotation about y and position along x err together.
const std::array<double, 6> kSigma{0.004, 0.002, 0.006, 0.005, 0.003, 0.02};
constexpr double kTogether = 0.8;

Covariance claimed(double scale) {
  Covariance c{};
  for (std::size_t i = 0; i < 6; ++i) c[7 * i] = scale * scale * kSigma[i] * kSigma[i];
  c[6 * 1 + 3] = c[6 * 3 + 1] = scale * scale * kTogether * kSigma[1] * kSigma[3];
  return c;
}

struct Log {
  std::vector<StampedPose> truth, estimate;

  explicit Log(int poses) {
    std::mt19937 generator(5);
    std::normal_distribution<double> normal;
    for (int i = 0; i < poses; ++i) {
      truth.push_back(truth_at(i));
      std::array<double, 6> e{};
      for (double& v : e) v = normal(generator);
      e[3] = kTogether * e[1] + std::sqrt(1 - kTogether * kTogether) * e[3];
      for (std::size_t k = 0; k < 6; ++k) e[k] *= kSigma[k];
      const Pose error{exp_so3({e[0], e[1], e[2]}), {e[3], e[4], e[5]}};
      const Pose T_camera_world = error * inverse(truth.back().T_world_camera);
      estimate.push_back({truth.back().stamp_ns, inverse(T_camera_world)});
    }
  }
  double share(double scale) const {
    return share_in_ellipsoid(truth, estimate, std::vector<Covariance>(estimate.size(), claimed(scale)));
  }
};

TEST(ShareInEllipsoid, NineTenthsWhereTheCovarianceIsTheErrors) {
  const Log log(3000);
  EXPECT_NEAR(log.share(1), 0.9, 0.02);
  EXPECT_LT(log.share(0.5), 0.25) << "too sure of itself";
  EXPECT_GT(log.share(2), 0.99);
}

TEST(ShareInEllipsoid, TakesTheTruthBetweenItsStamps) {
  Log log(400);
  std::vector<StampedPose> sparse;
  for (std::size_t i = 0; i < log.truth.size(); i += 2) sparse.push_back(log.truth[i]);
  log.truth = sparse;
  EXPECT_NEAR(log.share(1), 0.9, 0.05);
}

TEST(ShareInEllipsoid, WhatHasNoTruthOrNoPartnerIsLeftOut) {
  EXPECT_TRUE(std::isnan(Log(15).share(1))) << "shorter than a second";
  Log gap(60);
  gap.truth.erase(gap.truth.begin() + 5, gap.truth.begin() + 55);
  EXPECT_TRUE(std::isnan(gap.share(1))) << "no truth a second after another";
  EXPECT_TRUE(std::isnan(share_in_ellipsoid({}, {}, {})));
}

}  // namespace
}  // namespace stillmap
