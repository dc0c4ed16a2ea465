// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <utility>

#include "core/arena.h"
#include "track/turns.h"
#include "track/window_adjuster.h"
#include "track/window_selector.h"

namespace stillmap {

/// Adjusts the local map's newest part beside tracking. The tracker offers a copy of it, a worker adjusts the
/// copy, the tracker takes the result back into the map.
class LocalAdjustment {
 public:
  LocalAdjustment(Arena& arena, const CameraModel& camera, std::size_t points)
      : window_(arena), selector_(arena, camera, points), adjuster_(arena, camera) {}

  /// The tracker's, after a new keyframe. Nothing happens while the worker is behind: the next keyframe's
  /// window holds this one too.
  void offer(LocalMap& map, const FeatureExtractor& extractor) {
    if (turns_.at_rest() && selector_.select(map, extractor, window_)) turns_.offer();
  }
  /// The tracker's, before a frame. The newest keyframe's move (T_odom_camera after = move * before), which
  /// what else is known of the present must follow; nothing where no result is there.
  std::optional<Pose> collect(LocalMap& map) {
    if (!turns_.done()) return std::nullopt;
    std::optional<Pose> move;
    if (!std::exchange(outdated_, false)) move = WindowSelector::apply(window_, map);
    turns_.rest();
    return move;
  }
  /// The tracker's: the map has been mended otherwise, a window that is out is not to be taken back.
  void outdate() { outdated_ = !turns_.at_rest(); }

  /// Any thread: there is work.
  bool waits() const { return turns_.waits(); }
  /// The worker's; nothing where none waits.
  void work() {
    if (!waits()) return;
    adjuster_.adjust(window_);
    turns_.finish();
  }

 private:
  Turns turns_;
  bool outdated_ = false;  // the tracker's
  AdjustmentWindow window_;
  WindowSelector selector_;
  WindowAdjuster adjuster_;
};

}  // namespace stillmap
