// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "core/geometry.h"
#include "core/random.h"

namespace stillmap {

/// One thing seen in two frames, in undistorted pixels.
struct Correspondence {
  Vec2 first, second;
};

/// Distance in px of the second pixel from the epipolar line of the first: |P2' F P1| / sqrt(X^2 + Y^2) with
/// (X, Y, Z) = F P1 (seed paper, equations 2 and 3). Infinite where the line is not defined.
double epipolar_distance(const Mat3& F, Correspondence c);

/// The fundamental matrix by the normalised eight-point method (Hartley, PAMI 19(6), 1997) in RANSAC: the one
/// with most correspondences within `threshold_px` of their line, fitted anew to all of those. Nothing below
/// 15 correspondences, where fewer than half agree, or where nearly as many agree with quite another matrix:
/// points of one plane, or a camera that hardly moved, determine none. The same `random` gives the same
/// answer. No heap; any thread.
std::optional<Mat3> fundamental_by_ransac(std::span<const Correspondence> correspondences,
                                          double threshold_px, Random random);

}  // namespace stillmap
