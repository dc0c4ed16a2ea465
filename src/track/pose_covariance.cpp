// SPDX-License-Identifier: Apache-2.0
#include "track/pose_covariance.h"

#include <algorithm>

namespace stillmap {

namespace {

// Errors of neighbouring corners come together: its sigmas are too small.
constexpr double kSolverShare = 1.5;
constexpr double kMapSigma_rad = 0.002, kMapSigma_m = 0.003;
// Rows that were exposed at different times look like a shift of the camera as much as like a turn.
constexpr double kLever_m = 0.5;
constexpr double kMajority = 0.5, kDoubt_rad = 0.2, kDoubt_m = 0.15;  // doubt at its largest

double square(double v) {
  return v * v;
}

}  // namespace

CameraSpeed speed_between(const Pose& T_odom_before, const Pose& T_odom_now, double seconds) {
  if (seconds <= 0) return {};
  const Pose moved = inverse(T_odom_before) * T_odom_now;
  return {norm(log_so3(moved.R)) / seconds, norm(moved.t) / seconds};
}

std::array<double, 36> honest_covariance(const PoseEstimate& estimate, CameraSpeed speed,
                                         double stamp_sigma_s) {
  const double turned = stamp_sigma_s * speed.rad_per_s, went = stamp_sigma_s * speed.m_per_s;
  const double agreeing =
      estimate.observed > 0 ? static_cast<double>(estimate.inliers) / estimate.observed : 1;
  const double doubt = square(std::max(0.0, 1 - agreeing / kMajority));
  const double rotation = square(kMapSigma_rad) + square(turned) + square(kDoubt_rad * doubt);
  const double translation =
      square(kMapSigma_m) + square(went) + square(kLever_m * turned) + square(kDoubt_m * doubt);
  std::array<double, 36> out{};
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = square(kSolverShare) * estimate.covariance[i];
  for (std::size_t i = 0; i < 6; ++i) out[7 * i] += i < 3 ? rotation : translation;
  return out;
}

}  // namespace stillmap
