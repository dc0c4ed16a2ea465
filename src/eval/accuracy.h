// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

#include "core/status.h"
#include "eval/trajectory.h"

namespace stillmap {

/// How near an estimated trajectory is to the ground truth (Sturm et al., IROS 2012, section IV).
struct Accuracy {
  /// Absolute trajectory error: distances of positions after the best SE(3) alignment, without scale.
  double ate_rmse_m = 0, ate_max_m = 0;
  /// Relative pose error over one second (their eq. 1). NaN where no two matched poses are a second apart.
  double rpe_1s_rmse_m = 0, rpe_1s_rmse_deg = 0;
  /// The same from each matched pose to the next.
  double rpe_frame_rmse_m = 0;
  std::size_t matched_poses = 0;
  /// Matched poses over frames that could have matched, 0 to 1. The errors tell of this share only. NaN where
  /// the frames are not known.
  double coverage = 0;
};

/// Compares two trajectories with strictly rising stamps. For work after a run: it uses the heap.
///
/// Each estimated pose is matched to the ground truth's nearest stamp within 20 ms. Pairs for the error over
/// 1 s are made as TUM's evaluate_rpe.py with a fixed delta makes them (to each pose the one nearest to 1 s
/// later, unless that is the very last), but a pair more than 0.1 s off one second is left out, so that a gap
/// in the estimate is not measured over another time.
///
/// `frame_stamps` are the colour stamps of all offered frames; coverage counts those with ground truth within
/// 20 ms. What frames there were, neither of the trajectories tells.
///
/// Errors (UnreadableInput): stamps that do not rise, a pose that is not finite, fewer than three matches.
Result<Accuracy> evaluate(std::span<const StampedPose> groundtruth, std::span<const StampedPose> estimate,
                          std::span<const Nanoseconds> frame_stamps);

}  // namespace stillmap
