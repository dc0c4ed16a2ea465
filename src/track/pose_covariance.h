// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "core/geometry.h"
#include "track/pose_solver.h"

namespace stillmap {

/// How fast a camera moves.
struct CameraSpeed {
  double rad_per_s = 0, m_per_s = 0;
};
/// From one pose to a later one.
CameraSpeed speed_between(const Pose& T_odom_before, const Pose& T_odom_now, double seconds);

/// A pose's covariance as it holds against the truth, of the same form as PoseEstimate::covariance. The
/// solver knows of corners alone, each for itself. This adds what they have in common: the map's own error;
/// exposure that is not where the stamp is, be it by a rolling shutter or a clock, `stamp_sigma_s` (1 sigma)
/// times the speed; and doubt where less than half of what was observed agrees: something else may be right,
/// such as that a mover was followed. The constants are fitted to the share of errors over one second inside
/// the 90 % ellipsoid (eval/consistency.h); docs/measurements.md has the figures.
std::array<double, 36> honest_covariance(const PoseEstimate& estimate, CameraSpeed speed,
                                         double stamp_sigma_s);

}  // namespace stillmap
