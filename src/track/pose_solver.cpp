// SPDX-License-Identifier: Apache-2.0
#include "track/pose_solver.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cmath>
#include <optional>

#include "core/feature.h"
#include "core/fixed_vector.h"
#include "track/least_squares.h"
#include "track/rigid_consensus.h"

namespace stillmap {

namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Row6 = Eigen::Matrix<double, 1, 6>;

constexpr int kRounds = 4, kIterationsPerRound = 5, kFewestObservations = 6, kFewestWithPrior = 3;
// Of the weight, what agrees loosely: with a pose that is only a little off, most; with one that descent
// ended in by chance, less than this. With one found by samples, clearly more than that.
constexpr double kAstray = 0.35, kClearly = 1.2;
constexpr double kLoose = 9;          // times chi-square's limit: what three points' noise does to a pose
constexpr double kLeastShare = 0.15;  // of what is observed; fewer agree with any pose
constexpr int kSamples = 300;
constexpr std::size_t kFewestPairs = 12;

/// Whitened residuals of one observation and the point in the camera frame they come from.
struct Residual {
  Vec3 p_camera;
  double u = 0, v = 0, z = 0;
  bool valid = false;  // in front of the camera
  double chi2() const { return u * u + v * v + z * z; }
};

Residual residual_of(const PoseObservation& o, const CameraModel& camera, const Pose& T_camera_world) {
  Residual r;
  r.p_camera = T_camera_world * o.p_world;
  if (r.p_camera.z < 0.05) return r;
  r.valid = true;
  r.u = camera.fx * (r.p_camera.x / r.p_camera.z - o.ray_x) / o.sigma_px;
  r.v = camera.fy * (r.p_camera.y / r.p_camera.z - o.ray_y) / o.sigma_px;
  if (o.depth_m > 0) r.z = (r.p_camera.z - o.depth_m) / o.sigma_depth_m;
  return r;
}

double limit_of(const PoseObservation& o) {
  return o.depth_m > 0 ? kChi2ThreeDof : kChi2TwoDof;
}

/// Derivative of one whitened residual row by the left perturbation, from its derivative by the point:
/// p -> p + w x p + v, so d/dw = p x g and d/dv = g.
Row6 row_of(Vec3 g, Vec3 p) {
  const Vec3 w = cross(p, g);
  Row6 row;
  row << w.x, w.y, w.z, g.x, g.y, g.z;
  return row;
}

struct NormalEquations {
  Matrix6 H = Matrix6::Zero();
  Vector6 b = Vector6::Zero();

  void add(const PoseObservation& o, const CameraModel& camera, const Residual& r, bool robust) {
    const double chi = std::sqrt(r.chi2()), limit = std::sqrt(limit_of(o));
    const double weight = o.weight * (robust && chi > limit ? limit / chi : 1);  // Huber
    const Vec3 p = r.p_camera;
    const double iz = 1 / p.z, fx = camera.fx / o.sigma_px, fy = camera.fy / o.sigma_px;
    add_row(row_of({fx * iz, 0, -fx * p.x * iz * iz}, p), r.u, weight);
    add_row(row_of({0, fy * iz, -fy * p.y * iz * iz}, p), r.v, weight);
    if (o.depth_m > 0) add_row(row_of({0, 0, 1 / o.sigma_depth_m}, p), r.z, weight);
  }
  /// The deviation from the prior, to first order its own derivative.
  void add(const PosePrior& prior, const Pose& T_camera_world) {
    const Pose deviation = T_camera_world * inverse(prior.T_camera_world);
    const Vec3 w = log_so3(deviation.R);
    const double rotation = 1 / (prior.sigma_rotation_rad * prior.sigma_rotation_rad);
    const double translation = 1 / (prior.sigma_translation_m * prior.sigma_translation_m);
    Vector6 information, residual;
    information << rotation, rotation, rotation, translation, translation, translation;
    residual << w.x, w.y, w.z, deviation.t.x, deviation.t.y, deviation.t.z;
    H.diagonal() += information;
    b -= information.cwiseProduct(residual);
  }
  void add_row(const Row6& row, double residual, double weight) {
    H.noalias() += weight * row.transpose() * row;
    b.noalias() -= weight * residual * row.transpose();
  }
};

bool agrees(const PoseObservation& o, const CameraModel& camera, const Pose& T_camera_world,
            double looseness) {
  const Residual r = residual_of(o, camera, T_camera_world);
  return r.valid && r.chi2() <= looseness * limit_of(o);
}

/// Of the weight, how much agrees with a pose, loosely.
double agreeing_share(std::span<const PoseObservation> observations, const CameraModel& camera,
                      const Pose& T_camera_world) {
  double total = 0, agreeing = 0;
  for (const PoseObservation& o : observations) {
    total += o.weight;
    if (o.weight > 0 && agrees(o, camera, T_camera_world, kLoose)) agreeing += o.weight;
  }
  return total > 0 ? agreeing / total : 0;
}

/// The pose that the largest share agrees with, if more than `share_to_beat`.
std::optional<Pose> sample_pose(std::span<const PoseObservation> observations, const CameraModel& camera,
                                double share_to_beat, Random random) {
  FixedVector<std::uint16_t, kMaxFeatures> usable;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (observations[i].weight > 0 && observations[i].depth_m > 0)
      static_cast<void>(usable.try_push_back(static_cast<std::uint16_t>(i)));
  }
  if (usable.size() < kFewestPairs) return std::nullopt;
  const auto pair_at = [&](std::size_t i) {
    const PoseObservation& o = observations[usable[i]];
    return PointPair{o.p_world, o.depth_m * Vec3{o.ray_x, o.ray_y, 1}, 3 * o.sigma_depth_m + 0.005};
  };
  return rigid_consensus(usable.size(), kSamples, share_to_beat, random, pair_at,
                         [&](const Pose& T) { return agreeing_share(observations, camera, T); });
}

}  // namespace

PoseEstimate solve_pose(std::span<PoseObservation> observations, const CameraModel& camera,
                        const Pose& T_camera_world_initial, const PosePrior* prior) {
  PoseEstimate estimate{.T_camera_world = T_camera_world_initial};
  Pose T = T_camera_world_initial;
  NormalEquations equations;
  const int fewest = prior != nullptr ? kFewestWithPrior : kFewestObservations;
  for (int round = 0; round < kRounds; ++round) {
    for (int iteration = 0; iteration < kIterationsPerRound; ++iteration) {
      equations = {};
      int used = 0;
      for (const PoseObservation& o : observations) {
        if (!o.inlier || o.weight <= 0) continue;
        const Residual r = residual_of(o, camera, T);
        if (!r.valid) continue;
        equations.add(o, camera, r, round < kRounds - 1);
        ++used;
      }
      if (used < fewest) return estimate;
      if (prior != nullptr) equations.add(*prior, T);
      const Eigen::LDLT<Matrix6> ldlt(equations.H);
      if (ldlt.info() != Eigen::Success || ldlt.vectorD().minCoeff() <= 1e-9) return estimate;
      const Vector6 step = ldlt.solve(equations.b);
      T = perturbed(T, {step[0], step[1], step[2], step[3], step[4], step[5]});
      if (!is_finite(T)) return estimate;
      if (step.squaredNorm() < 1e-10) break;
    }
    estimate.inliers = estimate.observed = 0;
    double squared_px = 0;
    for (PoseObservation& o : observations) {
      const Residual r = residual_of(o, camera, T);
      o.inlier = r.valid && r.chi2() <= limit_of(o);
      estimate.observed += o.weight > 0;
      if (!o.inlier || o.weight <= 0) continue;
      ++estimate.inliers;
      squared_px += (r.u * r.u + r.v * r.v) * o.sigma_px * o.sigma_px;
    }
    if (estimate.inliers < fewest) return estimate;
    estimate.rms_px = std::sqrt(squared_px / estimate.inliers);
  }
  estimate.T_camera_world = T;
  estimate.converged = true;
  const Matrix6 covariance = equations.H.ldlt().solve(Matrix6::Identity());
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(estimate.covariance.data()) = covariance;
  return estimate;
}

PoseEstimate solve_pose_among_outliers(std::span<PoseObservation> observations, const CameraModel& camera,
                                       const Pose& T_camera_world_initial, const PosePrior* prior,
                                       Random random) {
  const PoseEstimate descended = solve_pose(observations, camera, T_camera_world_initial, prior);
  const double share =
      descended.converged ? agreeing_share(observations, camera, descended.T_camera_world) : 0;
  if (share >= kAstray) return descended;
  const std::optional<Pose> sampled = sample_pose(observations, camera, kClearly * share, random);
  if (!sampled) return descended;
  for (PoseObservation& o : observations) o.inlier = agrees(o, camera, *sampled, kLoose);
  const PoseEstimate estimate = solve_pose(observations, camera, *sampled, prior);
  if (estimate.converged && estimate.inliers >= kLeastShare * estimate.observed &&
      (!descended.converged || estimate.inliers > descended.inliers))
    return estimate;
  for (PoseObservation& o : observations) o.inlier = agrees(o, camera, descended.T_camera_world, 1);
  return descended;
}

}  // namespace stillmap
