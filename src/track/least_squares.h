// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "core/geometry.h"

namespace stillmap {

/// 95 % quantiles of chi-square with two and three degrees of freedom: what a whitened residual of a pixel,
/// or of a pixel and its depth, stays below when its match is right.
constexpr double kChi2TwoDof = 5.991, kChi2ThreeDof = 7.815;

/// The pose after a small left perturbation: d = (rotation vector in rad, translation in m).
inline Pose perturbed(const Pose& T, const std::array<double, 6>& d) {
  const Mat3 dR = exp_so3({d[0], d[1], d[2]});
  return {orthonormalized(dR * T.R), dR * T.t + Vec3{d[3], d[4], d[5]}};
}

}  // namespace stillmap
