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

  /// After keyframe `slot` has been made.
  void ask(const LocalMap& map, std::size_t slot, PlaceIndex& places) {
    if (!correcting_) closer_.ask(map, slot, places, map.first_keyframe_of_segment());
  }
  /// The next slice. When a loop has been closed, the map is mended, its segments are one, and what map ->
  /// odom is to be multiplied by from the right is returned.
  std::optional<Pose> step(LocalMap& map, Random random) {
    std::optional<Pose> moved;
    if (!correcting_) {
      const std::optional<LoopEdge> loop = closer_.step(map, random);
      correcting_ = loop && correction_.begin(map, *loop, map.first_keyframe_of_segment());
    } else if (!(correcting_ = correction_.step())) {
      moved = correction_.apply(map);
      if (moved) map.join_segments();
    }
    return moved;
  }
  const LoopCounts& counts() const { return closer_.counts(); }

 private:
  LoopCloser closer_;
  LoopCorrection correction_;
  bool correcting_ = false;
};

}  // namespace stillmap
