// SPDX-License-Identifier: Apache-2.0
#include "track/pose_covariance.h"

namespace stillmap {

namespace {

constexpr double kSolverShare = 2;  // errors of neighbouring corners come together: its sigmas are too small
constexpr double kMapSigma_rad = 0.002, kMapSigma_m = 0.003;
// Rows that were exposed at different times look like a shift of the camera as much as like a turn.
constexpr double kLever_m = 0.5;

double square(double v) {
  return v * v;
}

}  // namespace

CameraSpeed speed_between(const Pose& T_odom_before, const Pose& T_odom_now, double seconds) {
  if (seconds <= 0) return {};
  const Pose moved = inverse(T_odom_before) * T_odom_now;
  return {norm(log_so3(moved.R)) / seconds, norm(moved.t) / seconds};
}

std::array<double, 36> honest_covariance(const std::array<double, 36>& solved, CameraSpeed speed,
                                         double stamp_sigma_s) {
  const double turned = stamp_sigma_s * speed.rad_per_s, went = stamp_sigma_s * speed.m_per_s;
  const double rotation = square(kMapSigma_rad) + square(turned);
  const double translation = square(kMapSigma_m) + square(went) + square(kLever_m * turned);
  std::array<double, 36> out{};
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = square(kSolverShare) * solved[i];
  for (std::size_t i = 0; i < 6; ++i) out[7 * i] += i < 3 ? rotation : translation;
  return out;
}

}  // namespace stillmap
