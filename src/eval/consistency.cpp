// SPDX-License-Identifier: Apache-2.0
#include "eval/consistency.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace stillmap {

namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr Nanoseconds kSecond_ns = 1'000'000'000, kTolerance_ns = 100'000'000;
constexpr Nanoseconds kLongestGap_ns = 200'000'000;  // of the ground truth, that is bridged
constexpr double kChi2Of90Percent = 10.645;          // six degrees of freedom

bool earlier(const StampedPose& p, Nanoseconds t) {
  return p.stamp_ns < t;
}

/// Between its two nearest poses: what moves fast is elsewhere half a period later.
std::optional<Pose> truth_at(std::span<const StampedPose> groundtruth, Nanoseconds stamp_ns) {
  const auto after = std::lower_bound(groundtruth.begin(), groundtruth.end(), stamp_ns, earlier);
  if (after == groundtruth.end()) return std::nullopt;
  if (after->stamp_ns == stamp_ns) return after->T_world_camera;
  if (after == groundtruth.begin()) return std::nullopt;
  const StampedPose &a = after[-1], &b = *after;
  if (b.stamp_ns - a.stamp_ns > kLongestGap_ns) return std::nullopt;
  const double share = to_seconds(stamp_ns - a.stamp_ns) / to_seconds(b.stamp_ns - a.stamp_ns);
  return interpolate(a.T_world_camera, b.T_world_camera, share);
}

/// How a left perturbation of T_i_world moves T_j_i = T_j_world * T_world_i.
Matrix6 adjoint(const Pose& T) {
  Eigen::Matrix3d R, skew;
  R << T.R.m[0], T.R.m[1], T.R.m[2], T.R.m[3], T.R.m[4], T.R.m[5], T.R.m[6], T.R.m[7], T.R.m[8];
  skew << 0, -T.t.z, T.t.y, T.t.z, 0, -T.t.x, -T.t.y, T.t.x, 0;
  Matrix6 A = Matrix6::Zero();
  A.topLeftCorner<3, 3>() = A.bottomRightCorner<3, 3>() = R;
  A.bottomLeftCorner<3, 3>() = skew * R;
  return A;
}

}  // namespace

double share_in_ellipsoid(std::span<const StampedPose> groundtruth, std::span<const StampedPose> estimate,
                          std::span<const std::array<double, 36>> covariances) {
  double pairs = 0, inside = 0;
  for (std::size_t i = 0; i < covariances.size(); ++i) {
    const Nanoseconds begin = estimate[i].stamp_ns;
    const auto next =
        std::lower_bound(estimate.begin(), estimate.end(), begin + kSecond_ns - kTolerance_ns, earlier);
    const auto j = static_cast<std::size_t>(next - estimate.begin());
    if (j >= covariances.size() || next->stamp_ns > begin + kSecond_ns + kTolerance_ns) continue;
    const auto truth_i = truth_at(groundtruth, begin), truth_j = truth_at(groundtruth, next->stamp_ns);
    if (!truth_i || !truth_j) continue;
    const Pose T_j_i = inverse(next->T_world_camera) * estimate[i].T_world_camera;
    const Pose T_j_i_true = inverse(*truth_j) * *truth_i;
    const Pose off = T_j_i * inverse(T_j_i_true);
    const Vec3 w = log_so3(off.R);
    Vector6 error;
    error << w.x, w.y, w.z, off.t.x, off.t.y, off.t.z;
    const Matrix6 A = adjoint(T_j_i);
    const Matrix6 covariance = Eigen::Map<const Matrix6>(covariances[j].data()) +
                               A * Eigen::Map<const Matrix6>(covariances[i].data()) * A.transpose();
    ++pairs;
    inside += error.dot(covariance.ldlt().solve(error)) <= kChi2Of90Percent;
  }
  return pairs > 0 ? inside / pairs : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace stillmap
