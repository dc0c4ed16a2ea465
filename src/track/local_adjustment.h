// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <optional>
#include <utility>

#include "core/arena.h"
#include "track/window_adjuster.h"
#include "track/window_selector.h"

namespace stillmap {

/// Adjusts the local map's newest part beside tracking. The tracker offers a copy of it, a worker adjusts the
/// copy, the tracker takes the result back into the map: neither waits for the other, and no two threads ever
/// look at one piece of memory at once.
class LocalAdjustment {
 public:
  LocalAdjustment(Arena& arena, const CameraModel& camera, std::size_t points)
      : window_(arena), selector_(arena, camera, points), adjuster_(arena, camera) {}

  /// The tracker's, after a new keyframe. Nothing happens while the worker is behind: the next keyframe's
  /// window holds this one too.
  void offer(LocalMap& map, const FeatureExtractor& extractor) {
    if (phase_.load(std::memory_order_acquire) == Phase::Idle && selector_.select(map, extractor, window_))
      phase_.store(Phase::Offered, std::memory_order_release);
  }
  /// The tracker's, before a frame. The newest keyframe's move (T_odom_camera after = move * before), which
  /// what else is known of the present must follow; nothing where no result is there.
  std::optional<Pose> collect(LocalMap& map) {
    if (phase_.load(std::memory_order_acquire) != Phase::Adjusted) return std::nullopt;
    std::optional<Pose> move;
    if (!std::exchange(outdated_, false)) move = WindowSelector::apply(window_, map);
    phase_.store(Phase::Idle, std::memory_order_release);
    return move;
  }
  /// The tracker's: the map has been mended otherwise, a window that is out is not to be taken back.
  void outdate() { outdated_ = phase_.load(std::memory_order_acquire) != Phase::Idle; }

  /// Any thread: there is work.
  bool waits() const { return phase_.load(std::memory_order_acquire) == Phase::Offered; }
  /// The worker's; nothing where none waits.
  void work() {
    if (!waits()) return;
    adjuster_.adjust(window_);
    phase_.store(Phase::Adjusted, std::memory_order_release);
  }

 private:
  enum class Phase : std::uint8_t { Idle, Offered, Adjusted };
  std::atomic<Phase> phase_{Phase::Idle};
  bool outdated_ = false;  // the tracker's
  AdjustmentWindow window_;
  WindowSelector selector_;
  WindowAdjuster adjuster_;
};

}  // namespace stillmap
