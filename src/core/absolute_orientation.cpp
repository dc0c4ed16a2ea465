// SPDX-License-Identifier: Apache-2.0
#include "core/absolute_orientation.h"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <cmath>

namespace stillmap {

AbsoluteOrientation absolute_orientation(std::span<const Vec3> from, std::span<const Vec3> to) {
  const auto n = static_cast<double>(from.size());
  if (from.size() < 3 || from.size() != to.size()) return {};
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
  // Where the two largest are equal, every rotation between theirs is as good.
  const double gap = eigen.eigenvalues()[3] - eigen.eigenvalues()[2];
  const bool unique = gap >= 1e-9 * std::abs(eigen.eigenvalues()[3]) + 1e-15;
  const Eigen::Vector4d q = eigen.eigenvectors().col(3);
  const Mat3 R = rotation_from({q[0], q[1], q[2], q[3]});
  return {{R, mean_to - R * mean_from}, unique};
}

}  // namespace stillmap
