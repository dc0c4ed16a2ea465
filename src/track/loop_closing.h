// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "core/arena.h"
#include "track/loop_closer.h"
#include "track/loop_correction.h"
#include "track/place_index.h"

namespace stillmap {

/// From a keyframe to a mended map, a slice of work per frame: does it show a known place, and if so, where
/// must what lies between be? The tracker's thread; no heap after construction.
class LoopClosing {
 public:
  LoopClosing(Arena& arena, const Config::Track& config, const CameraModel& camera)
      : closer_(arena, config, camera),
        correction_(arena, static_cast<std::size_t>(config.keyframes),
                    static_cast<std::size_t>(config.points)) {}

  /// After keyframe `slot` has been made. Every third is asked for: neighbours see the same, and two that
  /// agree are still within the closer's reach.
  void ask(const LocalMap& map, std::size_t slot, PlaceIndex& places) {
    if (!correcting_ && map.keyframes()[slot].id % 3 == 0)
      closer_.ask(map, slot, places, map.first_keyframe_of_segment());
  }
  /// The next slice. When a loop has been closed, the map is mended, its segments are one, and what map ->
  /// odom is to be multiplied by from the right is returned.
  std::optional<Pose> step(LocalMap& map, Random random) {
    std::optional<Pose> moved;
    if (!correcting_) {
      const std::optional<LoopEdge> loop = closer_.step(map, random);
      correcting_ =
          loop && is_off(map, *loop) && correction_.begin(map, *loop, map.first_keyframe_of_segment());
    } else if (!(correcting_ = correction_.step())) {
      moved = correction_.apply(map);
      if (moved) map.join_segments();
    }
    return moved;
  }
  const LoopCounts& counts() const { return closer_.counts(); }

 private:
  /// A loop that tells little new is left alone: matching around the prediction bridges it, and a correction
  /// has an error of its own of some centimetres.
  static bool is_off(const LocalMap& map, const LoopEdge& loop) {
    constexpr double kOff_m = 0.08, kOff_rad = 0.04;
    const Keyframe *a = map.find_keyframe(loop.keyframe_a), *b = map.find_keyframe(loop.keyframe_b);
    if (a == nullptr || b == nullptr) return false;
    const Pose off = a->T_odom_camera * loop.T_a_b * inverse(b->T_odom_camera);
    return !map.in_segment(*b) || norm((off * b->T_odom_camera).t - b->T_odom_camera.t) > kOff_m ||
           norm(log_so3(off.R)) > kOff_rad;
  }
  LoopCloser closer_;
  LoopCorrection correction_;
  bool correcting_ = false;
};

}  // namespace stillmap
