// SPDX-License-Identifier: Apache-2.0
#include "track/relocalizer.h"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>

namespace stillmap {

namespace {

constexpr int kMaxDistance = 60;
constexpr double kRatio = 0.8;
constexpr int kSamples = 120;
constexpr double kInlierPx = 4;  // at octave 0

}  // namespace

std::optional<Pose> absolute_orientation(std::span<const Vec3> from, std::span<const Vec3> to) {
  const auto n = static_cast<double>(from.size());
  if (from.size() < 3 || from.size() != to.size()) return std::nullopt;
  Vec3 mean_from, mean_to;
  for (std::size_t i = 0; i < from.size(); ++i) {
    mean_from = mean_from + from[i];
    mean_to = mean_to + to[i];
  }
  mean_from = 1 / n * mean_from;
  mean_to = 1 / n * mean_to;
  Eigen::Matrix3d S = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Vec3 a = from[i] - mean_from, b = to[i] - mean_to;
    S += Eigen::Vector3d(a.x, a.y, a.z) * Eigen::RowVector3d(b.x, b.y, b.z);
  }
  Eigen::Matrix4d N;
  N << S(0, 0) + S(1, 1) + S(2, 2), S(1, 2) - S(2, 1), S(2, 0) - S(0, 2), S(0, 1) - S(1, 0),  //
      S(1, 2) - S(2, 1), S(0, 0) - S(1, 1) - S(2, 2), S(0, 1) + S(1, 0), S(2, 0) + S(0, 2),   //
      S(2, 0) - S(0, 2), S(0, 1) + S(1, 0), -S(0, 0) + S(1, 1) - S(2, 2), S(1, 2) + S(2, 1),  //
      S(0, 1) - S(1, 0), S(2, 0) + S(0, 2), S(1, 2) + S(2, 1), -S(0, 0) - S(1, 1) + S(2, 2);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(N);
  // Two equal largest eigenvalues: the rotation is not determined (points in a line or in one place).
  if (eigen.eigenvalues()[3] - eigen.eigenvalues()[2] < 1e-9 * std::abs(eigen.eigenvalues()[3]) + 1e-15)
    return std::nullopt;
  const Eigen::Vector4d q = eigen.eigenvectors().col(3);
  const Mat3 R = rotation_from({q[0], q[1], q[2], q[3]});
  return Pose{R, mean_to - R * mean_from};
}

Relocalizer::Relocalizer(Arena& arena, const Config::Track& config, const CameraModel& camera)
    : camera_(camera),
      fewest_inliers_(std::max(8, config.min_inliers / 2)),
      pairs_(arena.take<Pair>("relocalizer.pairs", Keyframe::kMaxFeatures)),
      observations_(arena.take<PoseObservation>("relocalizer.observations", Keyframe::kMaxFeatures)) {}

void Relocalizer::find_pairs(LocalMap& map, const Keyframe& keyframe, const FrameFeatures& frame) {
  pairs_.clear();
  for (std::size_t k = 0; k < keyframe.features.size(); ++k) {
    const MapPoint* point = map.find(keyframe.features[k].point);
    if (point == nullptr) continue;
    int best = 257, second = 257;
    std::size_t best_feature = 0;
    for (std::size_t i = 0; i < frame.features.size(); ++i) {
      if (frame.features[i].label == Label::Dynamic || frame.features[i].label == Label::Unknown) continue;
      const int distance = hamming(keyframe.descriptors[k], frame.descriptors[i]);
      if (distance < best) {
        second = best;
        best = distance;
        best_feature = i;
      } else if (distance < second) {
        second = distance;
      }
    }
    if (best > kMaxDistance || best > kRatio * second) continue;
    const Feature& f = frame.features[best_feature];
    const Vec3 p_camera = {f.ray_x * f.depth_m, f.ray_y * f.depth_m, f.depth_m};
    static_cast<void>(pairs_.try_push_back(
        {static_cast<std::uint16_t>(best_feature), static_cast<std::uint16_t>(k), p_camera, point->p_odom}));
  }
}

int Relocalizer::count_inliers(const Pose& T_camera_odom, const FrameFeatures& frame,
                               const FeatureExtractor& extractor) const {
  int inliers = 0;
  for (const Pair& pair : pairs_) {
    const Feature& f = frame.features[pair.feature];
    const Vec3 p = T_camera_odom * pair.p_odom;
    if (p.z <= 0.05) continue;
    const double du = camera_.fx * (p.x / p.z - f.ray_x), dv = camera_.fy * (p.y / p.z - f.ray_y);
    const double limit = kInlierPx * extractor.scale(f.octave);
    inliers += du * du + dv * dv < limit * limit;
  }
  return inliers;
}

std::optional<Pose> Relocalizer::relocalize(LocalMap& map, const Keyframe& keyframe,
                                            const FrameFeatures& frame, const FeatureExtractor& extractor,
                                            Random random) {
  find_pairs(map, keyframe, frame);
  const auto with_depth =
      std::partition(pairs_.begin(), pairs_.end(), [](const Pair& p) { return p.p_camera.z > 0; });
  const auto samples = static_cast<std::uint32_t>(with_depth - pairs_.begin());
  if (samples < 3 || static_cast<int>(pairs_.size()) < fewest_inliers_) return std::nullopt;
  Pose best;
  int best_inliers = 0;
  for (int round = 0; round < kSamples; ++round) {
    std::array<Vec3, 3> from, to;
    for (std::size_t i = 0; i < 3; ++i) {
      const Pair& pair = pairs_[random.below(samples)];
      from[i] = pair.p_odom;
      to[i] = pair.p_camera;
    }
    const std::optional<Pose> T = absolute_orientation(from, to);
    if (!T) continue;
    const int inliers = count_inliers(*T, frame, extractor);
    if (inliers > best_inliers) {
      best_inliers = inliers;
      best = *T;
    }
  }
  if (best_inliers < fewest_inliers_) return std::nullopt;
  observations_.clear();
  for (const Pair& pair : pairs_) {
    const Feature& f = frame.features[pair.feature];
    const double sigma_depth = f.depth_m > 0 ? 2 * camera_.depth_sigma_m(f.depth_m) + 0.01 : 0;
    static_cast<void>(observations_.try_push_back(
        {pair.p_odom, f.ray_x, f.ray_y, 1.5 * extractor.scale(f.octave), f.depth_m, sigma_depth}));
  }
  const PoseEstimate estimate = solve_pose(observations_, camera_, best);
  if (!estimate.converged || estimate.inliers < fewest_inliers_) return std::nullopt;
  return estimate.T_camera_world;
}

}  // namespace stillmap
