// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "eval/trajectory.h"

namespace stillmap {

/// Whether what the tracker says of its own error holds: of all poses one second apart (0.9 to 1.1 s), the
/// share whose relative error lies in the 90 % ellipsoid of its covariance; about 0.9 where it holds, less
/// where the tracker is too sure. NaN where no two poses with ground truth are a second apart.
///
/// `covariances[i]` is of estimate[i]'s inverse, left-multiplied: rotation in rad, translation in m, in the
/// camera frame, row-major. The two poses' errors are taken as independent. Both trajectories have rising
/// stamps. For work after a run.
double share_in_ellipsoid(std::span<const StampedPose> groundtruth, std::span<const StampedPose> estimate,
                          std::span<const std::array<double, 36>> covariances);

}  // namespace stillmap
