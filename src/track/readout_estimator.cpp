// SPDX-License-Identifier: Apache-2.0
#include "track/readout_estimator.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace stillmap {

namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Vector7 = Eigen::Matrix<double, 7, 1>;
using Matrix7 = Eigen::Matrix<double, 7, 7>;

// Before anything is seen: half way to what colour cameras beside depth sensors have, 20 ms and more; a
// global shutter is as near.
constexpr double kUsual_s = 0.01, kUsualSigma_s = 0.015;
constexpr double kSurest_s = 0.0005;  // never surer than that, so that it goes on learning
constexpr double kLongest_s = 0.033;
constexpr Nanoseconds kApart_ns = 150'000'000;
constexpr double kSigma_px = 1.5, kFar_px = 6;  // of a corner in two pictures; farther off it is another one
constexpr int kFewest = 50;
constexpr double kShared = 4;  // corners share errors of depth and turn: so many say as much as one

}  // namespace

ReadoutEstimator::ReadoutEstimator(Arena& arena, const CameraModel& camera, std::size_t points,
                                   std::size_t feature_capacity)
    : camera_(camera),
      sighting_of_slot_(arena.take<std::int32_t>("readout.sighting_of_slot", points)),
      sightings_(arena.take<Sighting>("readout.sightings", feature_capacity)),
      readout_s_(camera.readout_s.value_or(kUsual_s)),
      information_(1 / (kUsualSigma_s * kUsualSigma_s)) {}

Vec3 ReadoutEstimator::moved_per_s(const Feature& f, Vec3 p_camera, Vec3 turn_rad_per_s) const {
  return cross((double{f.y} / camera_.height - 0.5) * turn_rad_per_s, p_camera);
}

void ReadoutEstimator::observe(std::span<const Feature> features, std::span<const FeatureMatch> inliers,
                               Nanoseconds stamp_ns, const Pose& T_odom_camera, Vec3 turn_rad_per_s) {
  if (camera_.readout_s) return;
  if (!sightings_.empty() && std::abs(stamp_ns - stamp_ns_) < kApart_ns) return;  // clocks are set back, too
  const double straightened_by = readout_s_;
  if (!sightings_.empty())
    compare(features, inliers, inverse(T_odom_camera_) * T_odom_camera, turn_rad_per_s);
  stamp_ns_ = stamp_ns;
  T_odom_camera_ = T_odom_camera;
  sightings_readout_s_ = straightened_by;
  remember(features, inliers, turn_rad_per_s);
}

void ReadoutEstimator::remember(std::span<const Feature> features, std::span<const FeatureMatch> inliers,
                                Vec3 turn_rad_per_s) {
  sightings_.clear();
  for (std::size_t i = 0; i < features.size(); ++i) {
    const Feature& f = features[i];
    if (inliers[i].slot < 0 || f.depth_m <= 0) continue;
    const double z = f.depth_m;
    const Vec3 p = {f.ray_x * z, f.ray_y * z, z};
    sighting_of_slot_[static_cast<std::size_t>(inliers[i].slot)] =
        static_cast<std::int32_t>(sightings_.size());
    static_cast<void>(sightings_.try_push_back({inliers[i].slot, p, moved_per_s(f, p, turn_rad_per_s)}));
  }
}

void ReadoutEstimator::compare(std::span<const Feature> features, std::span<const FeatureMatch> inliers,
                               const Pose& T_past_now, Vec3 turn_rad_per_s) {
  const Pose T_now_past = inverse(T_past_now);
  Matrix7 H = Matrix7::Zero();
  Vector7 b = Vector7::Zero();
  int count = 0;
  for (std::size_t i = 0; i < features.size(); ++i) {
    if (inliers[i].slot < 0) continue;
    const auto at = static_cast<std::size_t>(sighting_of_slot_[static_cast<std::size_t>(inliers[i].slot)]);
    if (at >= sightings_.size() || sightings_[at].slot != inliers[i].slot) continue;
    const Sighting& past = sightings_[at];
    const Feature& f = features[i];
    const Vec3 ray{f.ray_x, f.ray_y, 1};
    const Vec3 turned = moved_per_s(f, ray, turn_rad_per_s);
    // Both places as they would be without any straightening, and what a second of readout adds to them.
    const Vec3 p = T_now_past * (past.p_camera - sightings_readout_s_ * past.moved_per_s);
    if (p.z < 0.1) continue;
    const Vec3 by = T_now_past.R * past.moved_per_s;
    const double x = p.x / p.z, y = p.y / p.z;
    const double seen_x = ray.x - readout_s_ * (turned.x - ray.x * turned.z);
    const double seen_y = ray.y - readout_s_ * (turned.y - ray.y * turned.z);
    const double fx = camera_.fx / kSigma_px, fy = camera_.fy / kSigma_px;
    Vector7 du, dv;  // by rotation, translation, readout
    du << -x * y, 1 + x * x, -y, 1 / p.z, 0, -x / p.z,
        (by.x - x * by.z) / p.z - (turned.x - ray.x * turned.z);
    dv << -1 - y * y, x * y, x, 0, 1 / p.z, -y / p.z, (by.y - y * by.z) / p.z - (turned.y - ray.y * turned.z);
    const double ru = x - seen_x + readout_s_ * du[6], rv = y - seen_y + readout_s_ * dv[6];
    if (std::hypot(camera_.fx * ru, camera_.fy * rv) > kFar_px) continue;
    H.noalias() += fx * fx * du * du.transpose() + fy * fy * dv * dv.transpose();
    b.noalias() -= fx * fx * ru * du + fy * fy * rv * dv;
    ++count;
  }
  if (count < kFewest) return;
  const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> pose(H.topLeftCorner<6, 6>());
  if (pose.info() != Eigen::Success || pose.vectorD().minCoeff() <= 1e-9) return;
  const Vector6 explained = pose.solve(H.topRightCorner<6, 1>());
  const double information = (H(6, 6) - explained.dot(H.topRightCorner<6, 1>())) / kShared;
  const double evidence = (b[6] - explained.dot(b.head<6>())) / kShared;
  information_ = std::min(information_ + information, 1 / (kSurest_s * kSurest_s));
  readout_s_ = std::clamp(readout_s_ + evidence / information_, -kLongest_s, kLongest_s);
}

}  // namespace stillmap
