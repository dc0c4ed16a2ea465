// SPDX-License-Identifier: Apache-2.0
#include "track/epipolar.h"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <array>
#include <cmath>
#include <limits>

namespace stillmap {

namespace {

constexpr std::size_t kFewest = 15;
constexpr int kSamples = 60;
using Sample = std::array<Correspondence, 8>;

/// Moves and scales pixels so that their centre is 0 and their mean distance from it sqrt(2).
struct Normalisation {
  double scale = 1, x = 0, y = 0;
  Vec2 operator()(Vec2 p) const { return {scale * (p.x - x), scale * (p.y - y)}; }
  Eigen::Matrix3d matrix() const {
    Eigen::Matrix3d m;
    m << scale, 0, -scale * x, 0, scale, -scale * y, 0, 0, 1;
    return m;
  }
};

Normalisation normalisation_of(const Sample& sample, Vec2 Correspondence::*side) {
  Normalisation n;
  for (const Correspondence& c : sample) {
    n.x += (c.*side).x / 8;
    n.y += (c.*side).y / 8;
  }
  double mean = 0;
  for (const Correspondence& c : sample) mean += std::hypot((c.*side).x - n.x, (c.*side).y - n.y) / 8;
  n.scale = mean > 0 ? std::sqrt(2.0) / mean : 1;
  return n;
}

Eigen::Matrix3d eight_point(const Sample& sample) {
  const Normalisation n1 = normalisation_of(sample, &Correspondence::first);
  const Normalisation n2 = normalisation_of(sample, &Correspondence::second);
  Eigen::Matrix<double, 9, 9> A = Eigen::Matrix<double, 9, 9>::Zero();
  for (const Correspondence& c : sample) {
    const Vec2 a = n1(c.first), b = n2(c.second);
    Eigen::Matrix<double, 9, 1> row;
    row << b.x * a.x, b.x * a.y, b.x, b.y * a.x, b.y * a.y, b.y, a.x, a.y, 1;
    A.noalias() += row * row.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> eigen(A);
  const Eigen::Matrix<double, 9, 1> f = eigen.eigenvectors().col(0);
  Eigen::Matrix3d F;
  F << f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8];
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d singular = svd.singularValues();
  singular[2] = 0;  // every epipolar line meets the epipole
  F = svd.matrixU() * singular.asDiagonal() * svd.matrixV().transpose();
  return n2.matrix().transpose() * F * n1.matrix();
}

}  // namespace

double epipolar_distance(const Mat3& F, Correspondence c) {
  const Vec3 line = F * Vec3{c.first.x, c.first.y, 1};
  const double length = std::hypot(line.x, line.y);
  if (length <= 0) return std::numeric_limits<double>::infinity();
  return std::abs(dot(line, {c.second.x, c.second.y, 1})) / length;
}

std::optional<Mat3> fundamental_by_ransac(std::span<const Correspondence> correspondences, double threshold_px,
                                          Random random) {
  if (correspondences.size() < kFewest) return std::nullopt;
  const auto count = static_cast<std::uint32_t>(correspondences.size());
  std::size_t best_inliers = 0;
  Mat3 best;
  for (int round = 0; round < kSamples; ++round) {
    Sample sample;
    for (Correspondence& c : sample) c = correspondences[random.below(count)];
    const Eigen::Matrix3d F = eight_point(sample);
    Mat3 candidate;
    for (int r = 0; r < 3; ++r) {
      for (int k = 0; k < 3; ++k) candidate(r, k) = F(r, k);
    }
    std::size_t inliers = 0;
    for (const Correspondence& c : correspondences) inliers += epipolar_distance(candidate, c) < threshold_px;
    if (inliers > best_inliers) {
      best_inliers = inliers;
      best = candidate;
    }
  }
  if (best_inliers * 2 < correspondences.size()) return std::nullopt;
  return best;
}

}  // namespace stillmap
