// SPDX-License-Identifier: Apache-2.0
#include "track/view_matcher.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

#include "track/rigid_consensus.h"

namespace stillmap {

namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;

constexpr int kMaxDistance = 64;
constexpr double kRatio = 0.9;
constexpr int kRivalDistance = 72;  // no nearest one is refused for a second nearest beyond that
constexpr float kSameSize = 2.5F;
constexpr int kSamples = 400;
constexpr int kFewestPairs = 8;
constexpr double kAgree_px = 5;  // at octave 0
constexpr double kFirstRadius_px = 12, kLastRadius_px = 6;
constexpr double kCornerSigma_px = 1.2;
constexpr double kSameSpot_px = 12, kSameSpotSlope = 0.03;  // how far depth may differ within that, of itself
// What the solver's covariance leaves out: lens, stamps, and errors that many features share.
constexpr double kLeastSigma_rad = 0.01, kLeastSigma_m = 0.015;

// What is believed of geometry alone.
constexpr int kFewestAgreeing = 30, kFewestInliers = 50, kFewestDepths = 60;
constexpr double kAgreeingDepths = 0.8, kLeastSpread = 0.035;
constexpr double kLargestSigma_m = 0.03, kLargestSigma_rad = 0.02;

Vec3 point_of(const KeyframeFeature& f) {
  return {f.ray_x * f.depth_m, f.ray_y * f.depth_m, f.depth_m};
}

}  // namespace

bool ViewMatch::is_convincing() const {
  return agreeing_pairs >= kFewestAgreeing && inliers >= kFewestInliers && depths >= kFewestDepths &&
         agreeing_depths >= kAgreeingDepths * depths && spread >= kLeastSpread &&
         sigma_m <= kLargestSigma_m && sigma_rad <= kLargestSigma_rad;
}

ViewMatcher::ViewMatcher(Arena& arena, const Config::Track& config, const CameraModel& camera)
    : camera_(camera),
      levels_(config.levels),
      best_of_a_(arena.take<Best>("view_matcher.best_a", kMaxFeatures)),
      best_of_b_(arena.take<Best>("view_matcher.best_b", kMaxFeatures)),
      pairs_(arena.take<Pair>("view_matcher.pairs", kMaxFeatures)),
      order_(arena.take<std::uint16_t>("view_matcher.order", kMaxFeatures)),
      in_order_(arena.take<Descriptor>("view_matcher.descriptors", kMaxFeatures)),
      observations_(arena.take<PoseObservation>("view_matcher.observations", kMaxFeatures)) {
  double scale = 1;
  for (double& s : scales_) {
    s = scale;
    scale *= config.scale_factor;
  }
}

double ViewMatcher::depth_sigma_m(double z_m) const {
  return 2 * camera_.depth_sigma_m(z_m) + 0.01;
}

/// Descriptors with those of patches of like size in the world: a corner is found again at the octave that
/// its distance asks for, give or take five.
void ViewMatcher::compare(const Keyframe& a, const Keyframe& b) {
  std::fill(best_of_a_.begin(), best_of_a_.end(), Best{});
  std::fill(best_of_b_.begin(), best_of_b_.end(), Best{});
  const auto note = [](Best& best, int distance, std::size_t other) {
    if (distance < best.distance) {
      best.second = best.distance;
      best.distance = static_cast<std::int16_t>(distance);
      best.other = static_cast<std::int16_t>(other);
    } else if (distance < best.second) {
      best.second = static_cast<std::int16_t>(distance);
    }
  };
  const auto size_m = [&](const KeyframeFeature& f) {
    return static_cast<float>(f.depth_m * scale(f.octave));
  };
  const auto size_at = [&](std::uint16_t j) { return size_m(b.features[j]); };
  order_.clear();
  for (std::size_t j = 0; j < b.features.size(); ++j) {
    if (b.features[j].depth_m > 0) static_cast<void>(order_.try_push_back(static_cast<std::uint16_t>(j)));
  }
  std::ranges::sort(order_, [&](std::uint16_t i, std::uint16_t j) {
    return std::pair(size_at(i), i) < std::pair(size_at(j), j);
  });
  for (std::size_t k = 0; k < order_.size(); ++k) in_order_[k] = b.descriptors[order_[k]];
  for (std::size_t i = 0; i < a.features.size(); ++i) {
    if (a.features[i].depth_m <= 0) continue;
    const Descriptor d = a.descriptors[i];
    const float size = size_m(a.features[i]);
    const auto from = [&](float least) {
      return static_cast<std::size_t>(std::ranges::lower_bound(order_, least, {}, size_at) - order_.begin());
    };
    for (std::size_t k = from(size / kSameSize), end = from(size * kSameSize); k < end; ++k) {
      const int distance = hamming(d, in_order_[k]);
      if (distance >= kRivalDistance) continue;
      const std::uint16_t j = order_[k];
      note(best_of_a_[i], distance, j);
      note(best_of_b_[j], distance, i);
    }
  }
}

void ViewMatcher::collect_pairs(const Keyframe& a, const Keyframe& b) {
  pairs_.clear();
  for (std::size_t i = 0; i < a.features.size(); ++i) {
    const Best& best = best_of_a_[i];
    if (best.other < 0 || best.distance > kMaxDistance || best.distance > kRatio * best.second) continue;
    const auto j = static_cast<std::size_t>(best.other);
    if (best_of_b_[j].other != static_cast<std::int16_t>(i)) continue;
    static_cast<void>(
        pairs_.try_push_back({point_of(a.features[i]), point_of(b.features[j]), a.features[i].octave}));
  }
}

bool ViewMatcher::agrees(const Pair& pair, const Pose& T_a_b) const {
  const Vec3 p = T_a_b * pair.p_b;
  if (p.z < 0.1) return false;
  const double du = camera_.fx * (p.x / p.z - pair.p_a.x / pair.p_a.z);
  const double dv = camera_.fy * (p.y / p.z - pair.p_a.y / pair.p_a.z);
  const double limit = kAgree_px * scale(pair.octave);
  return du * du + dv * dv < limit * limit && std::abs(p.z - pair.p_a.z) < 3 * depth_sigma_m(p.z);
}

int ViewMatcher::count_agreeing(const Pose& T_a_b) const {
  return static_cast<int>(
      std::count_if(pairs_.begin(), pairs_.end(), [&](const Pair& p) { return agrees(p, T_a_b); }));
}

std::optional<Pose> ViewMatcher::sample_motion(Random& random) const {
  const auto pair_at = [&](std::size_t i) {
    return PointPair{pairs_[i].p_b, pairs_[i].p_a, depth_sigma_m(pairs_[i].p_a.z)};
  };
  const auto pairs = static_cast<double>(pairs_.size());
  return rigid_consensus(pairs_.size(), kSamples, 0, random, pair_at,
                         [&](const Pose& T_a_b) { return count_agreeing(T_a_b) / pairs; });
}

void ViewMatcher::observe_pairs(const Pose& T_a_b) {
  observations_.clear();
  for (const Pair& pair : pairs_) {
    if (!agrees(pair, T_a_b)) continue;
    static_cast<void>(observations_.try_push_back({pair.p_b, pair.p_a.x / pair.p_a.z, pair.p_a.y / pair.p_a.z,
                                                   kCornerSigma_px * scale(pair.octave), pair.p_a.z,
                                                   depth_sigma_m(pair.p_a.z)}));
  }
}

/// Calls fn(i) for the features of `keyframe` within `radius` of x on the normalised plane; `order_` has them
/// by x.
template <class F>
void ViewMatcher::for_each_near(const Keyframe& keyframe, double x, double radius, F fn) const {
  const auto first =
      std::lower_bound(order_.begin(), order_.end(), x - radius,
                       [&](std::uint16_t i, double v) { return keyframe.features[i].ray_x < v; });
  for (auto i = first; i != order_.end() && keyframe.features[*i].ray_x <= x + radius; ++i)
    fn(static_cast<std::size_t>(*i));
}

void ViewMatcher::sort_by_x(const Keyframe& keyframe) {
  order_.clear();
  for (std::size_t i = 0; i < keyframe.features.size(); ++i)
    static_cast<void>(order_.try_push_back(static_cast<std::uint16_t>(i)));
  const auto x = [&](std::uint16_t i) { return std::pair(keyframe.features[i].ray_x, i); };
  std::sort(order_.begin(), order_.end(), [&](std::uint16_t i, std::uint16_t j) { return x(i) < x(j); });
}

void ViewMatcher::match_around(const Pose& T_a_b, const Keyframe& a, const Keyframe& b, double radius_px) {
  observations_.clear();
  const double widest = radius_px * scale(levels_ - 1) / camera_.fx;
  // Each feature of a is taken by the feature of b that looks most like it.
  std::fill(best_of_a_.begin(), best_of_a_.end(), Best{});
  for (std::size_t j = 0; j < b.features.size(); ++j) {
    if (b.features[j].depth_m <= 0) continue;
    const Vec3 p = T_a_b * point_of(b.features[j]);
    if (p.z < 0.1) continue;
    int nearest = kMaxDistance + 1;
    std::size_t found = 0;
    const double x = p.x / p.z, y = p.y / p.z;
    for_each_near(a, x, widest, [&](std::size_t i) {
      const KeyframeFeature& f = a.features[i];
      const double radius = radius_px * scale(f.octave), du = camera_.fx * (f.ray_x - x);
      if (std::abs(du) > radius || std::abs(camera_.fy * (f.ray_y - y)) > radius) return;
      if (f.depth_m > 0 && std::abs(f.depth_m - p.z) > 3 * depth_sigma_m(p.z)) return;
      const int distance = hamming(a.descriptors[i], b.descriptors[j]);
      if (distance >= nearest) return;
      nearest = distance;
      found = i;
    });
    if (nearest > kMaxDistance || nearest >= best_of_a_[found].distance) continue;
    best_of_a_[found] = {static_cast<std::int16_t>(nearest), 257, static_cast<std::int16_t>(j)};
  }
  for (std::size_t i = 0; i < a.features.size(); ++i) {
    if (best_of_a_[i].other < 0) continue;
    const KeyframeFeature& f = a.features[i];
    const Vec3 p_b = point_of(b.features[static_cast<std::size_t>(best_of_a_[i].other)]);
    const double sigma_depth = f.depth_m > 0 ? depth_sigma_m(f.depth_m) : 0;
    static_cast<void>(observations_.try_push_back(
        {p_b, f.ray_x, f.ray_y, kCornerSigma_px * scale(f.octave), f.depth_m, sigma_depth}));
  }
}

/// Depth speaks beside descriptors: another place seldom has the same depth in the same directions.
void ViewMatcher::count_depths(const Keyframe& a, const Keyframe& b, ViewMatch& out) const {
  for (const KeyframeFeature& f : b.features) {
    const Vec3 p = out.T_a_b * point_of(f);
    if (f.depth_m <= 0 || p.z < 0.1) continue;
    const double u = camera_.fx * p.x / p.z, v = camera_.fy * p.y / p.z;
    if (u < -camera_.cx || v < -camera_.cy || u > camera_.width - camera_.cx ||
        v > camera_.height - camera_.cy)
      continue;
    ++out.in_view;
    double nearest = kSameSpot_px * kSameSpot_px, depth = 0;
    for_each_near(a, p.x / p.z, kSameSpot_px / camera_.fx, [&](std::size_t i) {
      const KeyframeFeature& g = a.features[i];
      const double du = camera_.fx * g.ray_x - u, dv = camera_.fy * g.ray_y - v;
      if (g.depth_m <= 0 || du * du + dv * dv >= nearest) return;
      nearest = du * du + dv * dv;
      depth = g.depth_m;
    });
    if (depth <= 0) continue;
    ++out.depths;
    out.agreeing_depths += std::abs(depth - p.z) < 3 * depth_sigma_m(p.z) + kSameSpotSlope * p.z;
  }
}

/// Fills all of `out` but the counts of pairs.
void ViewMatcher::weigh(const PoseEstimate& estimate, const Keyframe& a, const Keyframe& b,
                        ViewMatch& out) const {
  out.T_a_b = estimate.T_camera_world;
  out.inliers = estimate.inliers;
  Matrix6 covariance = Eigen::Map<const Matrix6>(estimate.covariance.data());
  covariance.topLeftCorner<3, 3>().diagonal().array() += kLeastSigma_rad * kLeastSigma_rad;
  covariance.bottomRightCorner<3, 3>().diagonal().array() += kLeastSigma_m * kLeastSigma_m;
  Eigen::Map<Matrix6>(out.information.data()) = covariance.llt().solve(Matrix6::Identity());
  const auto worst = [](const Eigen::Matrix3d& m) {
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
    return std::sqrt(eigen.computeDirect(m, Eigen::EigenvaluesOnly).eigenvalues()[2]);
  };
  out.sigma_rad = worst(covariance.topLeftCorner<3, 3>());
  out.sigma_m = worst(covariance.bottomRightCorner<3, 3>());

  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  Eigen::Matrix2d square = Eigen::Matrix2d::Zero();
  for (const PoseObservation& o : observations_) {
    if (!o.inlier) continue;
    const Eigen::Vector2d p(camera_.fx * o.ray_x, camera_.fy * o.ray_y);
    mean += p / estimate.inliers;
    square += p * p.transpose() / estimate.inliers;
  }
  const Eigen::Matrix2d shape = square - mean * mean.transpose();
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen;
  const double narrow = eigen.computeDirect(shape, Eigen::EigenvaluesOnly).eigenvalues()[0];
  out.spread = std::sqrt(std::max(0.0, narrow)) / camera_.width;
  count_depths(a, b, out);
}

std::optional<ViewMatch> ViewMatcher::match(const Keyframe& a, const Keyframe& b, Random random) {
  compare(a, b);
  collect_pairs(a, b);
  ViewMatch out;
  out.pairs = static_cast<int>(pairs_.size());
  if (out.pairs < kFewestPairs) return std::nullopt;
  const std::optional<Pose> sampled = sample_motion(random);
  if (!sampled) return std::nullopt;
  out.agreeing_pairs = count_agreeing(*sampled);
  if (out.agreeing_pairs < kFewestPairs) return std::nullopt;
  observe_pairs(*sampled);
  sort_by_x(a);
  PoseEstimate estimate = solve_pose(observations_, camera_, *sampled);
  for (const double radius_px : {kFirstRadius_px, kLastRadius_px}) {
    if (!estimate.converged) return std::nullopt;
    match_around(estimate.T_camera_world, a, b, radius_px);
    estimate = solve_pose(observations_, camera_, estimate.T_camera_world);
  }
  if (!estimate.converged) return std::nullopt;
  weigh(estimate, a, b, out);
  return out;
}

}  // namespace stillmap
