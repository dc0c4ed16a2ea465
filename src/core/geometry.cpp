// SPDX-License-Identifier: Apache-2.0
#include "core/geometry.h"

#include <algorithm>

namespace stillmap {

Mat3 rotation_from(Quaternion q) {
  const double s = 2 / (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
  return {{1 - s * (q.y * q.y + q.z * q.z), s * (q.x * q.y - q.w * q.z), s * (q.x * q.z + q.w * q.y),
           s * (q.x * q.y + q.w * q.z), 1 - s * (q.x * q.x + q.z * q.z), s * (q.y * q.z - q.w * q.x),
           s * (q.x * q.z - q.w * q.y), s * (q.y * q.z + q.w * q.x), 1 - s * (q.x * q.x + q.y * q.y)}};
}

Quaternion quaternion_from(const Mat3& R) {
  // Shepperd's method: divide by the largest of the four components, so that no case loses precision.
  const double trace = R(0, 0) + R(1, 1) + R(2, 2);
  Quaternion q;
  if (trace >= std::max({R(0, 0), R(1, 1), R(2, 2)})) {
    q = {1 + trace, R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1)};
  } else if (R(0, 0) >= R(1, 1) && R(0, 0) >= R(2, 2)) {
    q = {R(2, 1) - R(1, 2), 1 + 2 * R(0, 0) - trace, R(0, 1) + R(1, 0), R(0, 2) + R(2, 0)};
  } else if (R(1, 1) >= R(2, 2)) {
    q = {R(0, 2) - R(2, 0), R(0, 1) + R(1, 0), 1 + 2 * R(1, 1) - trace, R(1, 2) + R(2, 1)};
  } else {
    q = {R(1, 0) - R(0, 1), R(0, 2) + R(2, 0), R(1, 2) + R(2, 1), 1 + 2 * R(2, 2) - trace};
  }
  double n = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
  if (q.w < 0) n = -n;
  return {q.w / n, q.x / n, q.y / n, q.z / n};
}

Mat3 exp_so3(Vec3 v) {
  const double angle = norm(v);
  const double half = angle / 2;
  const double s = angle < 1e-9 ? 0.5 : std::sin(half) / angle;
  return rotation_from({std::cos(half), s * v.x, s * v.y, s * v.z});
}

Vec3 log_so3(const Mat3& R) {
  const Quaternion q = quaternion_from(R);
  const double n = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z);
  const double s = n < 1e-9 ? 2 : 2 * std::atan2(n, q.w) / n;
  return {s * q.x, s * q.y, s * q.z};
}

Pose interpolate(const Pose& a, const Pose& b, double s) {
  return {a.R * exp_so3(s * log_so3(transposed(a.R) * b.R)), a.t + s * (b.t - a.t)};
}

Mat3 orthonormalized(const Mat3& R) {
  return rotation_from(quaternion_from(R));
}

bool is_finite(const Pose& T) {
  return std::all_of(T.R.m.begin(), T.R.m.end(), [](double v) { return std::isfinite(v); }) &&
         std::isfinite(T.t.x) && std::isfinite(T.t.y) && std::isfinite(T.t.z);
}

}  // namespace stillmap
