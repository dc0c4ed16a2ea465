// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>

namespace stillmap {

// Small value types that cross threads by memcpy. Solvers map them to Eigen; nobody else needs to.

/// A pixel or a point on the normalised image plane.
struct Vec2 {
  double x = 0, y = 0;
};

struct Vec3 {
  double x = 0, y = 0, z = 0;
};
constexpr Vec3 operator+(Vec3 a, Vec3 b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
constexpr Vec3 operator-(Vec3 a, Vec3 b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
constexpr Vec3 operator-(Vec3 a) {
  return {-a.x, -a.y, -a.z};
}
constexpr Vec3 operator*(double s, Vec3 a) {
  return {s * a.x, s * a.y, s * a.z};
}
constexpr double dot(Vec3 a, Vec3 b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
constexpr Vec3 cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double norm(Vec3 a) {
  return std::sqrt(dot(a, a));
}

/// 3x3 matrix, row-major: m[3 * row + column].
struct Mat3 {
  std::array<double, 9> m{1, 0, 0, 0, 1, 0, 0, 0, 1};
  constexpr double operator()(int r, int c) const { return m[static_cast<std::size_t>(3 * r + c)]; }
  constexpr double& operator()(int r, int c) { return m[static_cast<std::size_t>(3 * r + c)]; }
};
constexpr Vec3 operator*(const Mat3& a, Vec3 v) {
  return {a.m[0] * v.x + a.m[1] * v.y + a.m[2] * v.z, a.m[3] * v.x + a.m[4] * v.y + a.m[5] * v.z,
          a.m[6] * v.x + a.m[7] * v.y + a.m[8] * v.z};
}
constexpr Mat3 operator*(const Mat3& a, const Mat3& b) {
  Mat3 c;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) c(i, j) = a(i, 0) * b(0, j) + a(i, 1) * b(1, j) + a(i, 2) * b(2, j);
  }
  return c;
}
constexpr Mat3 transposed(const Mat3& a) {
  return {{a.m[0], a.m[3], a.m[6], a.m[1], a.m[4], a.m[7], a.m[2], a.m[5], a.m[8]}};
}

struct Quaternion {
  double w = 1, x = 0, y = 0, z = 0;
};
/// The rotation matrix of a quaternion; the quaternion need not be of unit length.
Mat3 rotation_from(Quaternion q);
/// The unit quaternion of a rotation matrix, with w >= 0.
Quaternion quaternion_from(const Mat3& R);
/// Rotation vector (axis times angle in rad) to rotation matrix, and back (angle in [0, pi]).
Mat3 exp_so3(Vec3 rotation_vector);
Vec3 log_so3(const Mat3& R);

/// A rigid transform. `T_a_b * p_b` gives p_a; `T_a_b * T_b_c` gives T_a_c. Translations in metres.
struct Pose {
  Mat3 R;
  Vec3 t;
};
constexpr Vec3 operator*(const Pose& T, Vec3 p) {
  return T.R * p + T.t;
}
constexpr Pose operator*(const Pose& a, const Pose& b) {
  return {a.R * b.R, a.R * b.t + a.t};
}
constexpr Pose inverse(const Pose& T) {
  const Mat3 Rt = transposed(T.R);
  return {Rt, -(Rt * T.t)};
}
/// The pose a share `s` of the way from a (s = 0) to b (s = 1), or beyond: rotation along the shortest arc,
/// translation along the line.
Pose interpolate(const Pose& a, const Pose& b, double s);
/// The nearest rotation matrix, for a product of many (keeps rounding from growing).
Mat3 orthonormalized(const Mat3& R);
bool is_finite(const Pose& T);

}  // namespace stillmap
