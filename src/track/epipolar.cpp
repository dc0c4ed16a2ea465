// SPDX-License-Identifier: Apache-2.0
#include "track/epipolar.h"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace stillmap {

namespace {

constexpr std::size_t kFewest = 15;
constexpr int kMostSamples = 200;
constexpr double kMissProbability = 1e-3;  // of never drawing a sample without outliers
// Where another matrix has this share of the best one's inliers, which of them is true is left to chance.
// Measured: on one wall the other one has 0.99 and more, in a room and from 20 mm of motion on less than 0.9.
constexpr double kAmbiguousShare = 0.95;
using Correspondences = std::span<const Correspondence>;

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

Normalisation normalisation_of(Correspondences all, Vec2 Correspondence::*side) {
  const auto n = static_cast<double>(all.size());
  Normalisation result;
  for (const Correspondence& c : all) {
    result.x += (c.*side).x / n;
    result.y += (c.*side).y / n;
  }
  double mean = 0;
  for (const Correspondence& c : all) mean += std::hypot((c.*side).x - result.x, (c.*side).y - result.y) / n;
  result.scale = mean > 0 ? std::sqrt(2.0) / mean : 1;
  return result;
}

/// The matrix that fits best, and the one of all that are orthogonal to it that fits next.
struct Solutions {
  Mat3 best, next;
};

Mat3 with_epipole(const Eigen::Matrix<double, 9, 1>& f, const Normalisation& n1, const Normalisation& n2) {
  Eigen::Matrix3d F;
  F << f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8];
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d singular = svd.singularValues();
  singular[2] = 0;  // every epipolar line meets the epipole
  F = n2.matrix().transpose() * (svd.matrixU() * singular.asDiagonal() * svd.matrixV().transpose()) *
      n1.matrix();
  Mat3 result;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) result(r, c) = F(r, c);
  }
  return result;
}

/// From those of `all` that `use` takes.
template <class Use>
Solutions eight_point(Correspondences all, Use&& use) {
  const Normalisation n1 = normalisation_of(all, &Correspondence::first);
  const Normalisation n2 = normalisation_of(all, &Correspondence::second);
  Eigen::Matrix<double, 9, 9> A = Eigen::Matrix<double, 9, 9>::Zero();
  for (const Correspondence& c : all) {
    if (!use(c)) continue;
    const Vec2 a = n1(c.first), b = n2(c.second);
    Eigen::Matrix<double, 9, 1> row;
    row << b.x * a.x, b.x * a.y, b.x, b.y * a.x, b.y * a.y, b.y, a.x, a.y, 1;
    A.noalias() += row * row.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> eigen(A);
  return {with_epipole(eigen.eigenvectors().col(0), n1, n2),
          with_epipole(eigen.eigenvectors().col(1), n1, n2)};
}

/// Eight different ones.
std::array<Correspondence, 8> draw(Correspondences all, Random& random) {
  std::array<std::uint32_t, 8> chosen;
  std::array<Correspondence, 8> sample;
  for (std::size_t i = 0; i < 8; ++i) {
    const auto before = chosen.begin() + static_cast<std::ptrdiff_t>(i);
    do {
      chosen[i] = random.below(static_cast<std::uint32_t>(all.size()));
    } while (std::find(chosen.begin(), before, chosen[i]) != before);
    sample[i] = all[chosen[i]];
  }
  return sample;
}

std::size_t agreeing(Correspondences all, const Mat3& F, double threshold_px) {
  return static_cast<std::size_t>(std::count_if(all.begin(), all.end(), [&](const Correspondence& c) {
    return epipolar_distance(F, c) < threshold_px;
  }));
}

/// How many samples it takes until one without outliers is among them.
int samples_needed(double inlier_share) {
  const double clean = std::pow(inlier_share, 8);
  if (clean <= 0) return kMostSamples;
  const double needed = std::log(kMissProbability) / std::log1p(-std::min(clean, 0.999));
  return static_cast<int>(std::min<double>(kMostSamples, std::ceil(needed)));
}

}  // namespace

double epipolar_distance(const Mat3& F, Correspondence c) {
  const Vec3 line = F * Vec3{c.first.x, c.first.y, 1};
  const double length = std::hypot(line.x, line.y);
  if (length <= 0) return std::numeric_limits<double>::infinity();
  return std::abs(dot(line, {c.second.x, c.second.y, 1})) / length;
}

std::optional<Mat3> fundamental_by_ransac(Correspondences correspondences, double threshold_px,
                                          Random random) {
  if (correspondences.size() < kFewest) return std::nullopt;
  std::size_t best_inliers = 0;
  Mat3 best;
  int samples = kMostSamples;
  for (int drawn = 0; drawn < samples; ++drawn) {
    const Mat3 candidate =
        eight_point(draw(correspondences, random), [](const Correspondence&) { return true; }).best;
    const std::size_t inliers = agreeing(correspondences, candidate, threshold_px);
    if (inliers <= best_inliers) continue;
    best_inliers = inliers;
    best = candidate;
    samples = samples_needed(static_cast<double>(inliers) / static_cast<double>(correspondences.size()));
  }
  if (best_inliers * 2 < correspondences.size()) return std::nullopt;
  const Solutions all = eight_point(
      correspondences, [&](const Correspondence& c) { return epipolar_distance(best, c) < threshold_px; });
  const auto agree_with_next = static_cast<double>(agreeing(correspondences, all.next, threshold_px));
  if (agree_with_next >= kAmbiguousShare * static_cast<double>(best_inliers)) return std::nullopt;
  return agreeing(correspondences, all.best, threshold_px) >= best_inliers ? all.best : best;
}

}  // namespace stillmap
