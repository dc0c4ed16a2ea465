// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>

#include "core/event.h"

namespace stillmap {

/// Since when each stage has been at work on one thing. A stage writes its own; the health thread judges.
class Watchdog {
 public:
  void begin(Stage stage, Nanoseconds now) { since_of(stage).store(now, std::memory_order_relaxed); }
  void end(Stage stage) { since_of(stage).store(0, std::memory_order_relaxed); }

  /// How long it has been at work; 0: it waits.
  Nanoseconds busy(Stage stage, Nanoseconds now) const {
    const Nanoseconds since = since_[static_cast<std::size_t>(stage)].load(std::memory_order_relaxed);
    return since == 0 ? 0 : now - since;
  }
  bool late(Stage stage, Nanoseconds now) const {
    return busy(stage, now) > kLimits[static_cast<std::size_t>(stage)];
  }
  /// A stage will hardly come back: only a restart helps. A camera that says nothing is left to its driver.
  bool stuck(Nanoseconds now) const {
    for (const Stage stage : {Stage::Detect, Stage::Track, Stage::Adjust, Stage::Map, Stage::Stream}) {
      if (busy(stage, now) > kStuck) return true;
    }
    return false;
  }

 private:
  std::atomic<Nanoseconds>& since_of(Stage stage) { return since_[static_cast<std::size_t>(stage)]; }
  static constexpr Nanoseconds kMillisecond = 1'000'000, kStuck = 10'000 * kMillisecond;
  // By Stage: capture waits for a frame, the detector, the adjustment and the map may take several frames'
  // time, the tracker not.
  static constexpr std::array<Nanoseconds, kStageCount> kLimits{
      1'000 * kMillisecond, 2'000 * kMillisecond, 300 * kMillisecond,  1'000 * kMillisecond,
      1'000 * kMillisecond, 1'000 * kMillisecond, 1'000 * kMillisecond};
  std::array<std::atomic<Nanoseconds>, kStageCount> since_{};
};

}  // namespace stillmap
