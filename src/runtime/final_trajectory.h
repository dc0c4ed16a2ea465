// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/arena.h"
#include "core/correction.h"
#include "core/tracking_result.h"
#include "eval/trajectory.h"

namespace stillmap {

/// Where the camera was, as it is known in the end: each pose hangs on its keyframe, and moves with it. The
/// track thread's until the run has ended; no heap before `poses`.
class FinalTrajectory {
 public:
  /// Room for so many poses; 0: nothing is kept.
  FinalTrajectory(Arena& arena, std::size_t poses)
      : poses_(arena.take<Hung>("final_trajectory", poses)),
        keyframes_(arena.take<Correction::KeyframePose>("final_trajectory.keyframes", poses)) {}

  /// A frame with a pose; T_odom_keyframe is its reference keyframe's now.
  void note(const TrackingResult& result, const Pose& T_odom_keyframe);
  /// Keyframes have moved. Those that the tracker has let go of move with the nearest of their segment that
  /// it still has.
  void correct(const Correction& correction);
  std::vector<StampedPose> poses() const;

 private:
  struct Hung {
    Nanoseconds stamp_ns = 0;
    std::uint32_t keyframe = 0;  // index into keyframes_
    Pose T_keyframe_camera;
  };
  ArenaVector<Hung> poses_;
  ArenaVector<Correction::KeyframePose> keyframes_;  // in the order they were made, so by id
};

}  // namespace stillmap
