// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "core/event.h"
#include "core/tracking_result.h"
#include "eval/trajectory.h"
#include "runtime/latency.h"

namespace stillmap {

/// Counts of a run. Each is written by one thread and may be read by any.
struct RunCounters {
  using Count = std::atomic<std::uint64_t>;
  Count offered{0}, processed{0};
  std::array<Count, kDropReasonCount> dropped{};
  Count tracked{0}, weak{0}, lost{0}, relocalized{0}, segments{0}, keyframes{0};
  Count static_features{0}, dynamic_features{0}, semi_static_features{0}, unknown_features{0};
  Count detector_runs{0}, detector_failures{0};
  std::atomic<int> state{0};  ///< TrackState
  Count newest_sequence{0};

  void drop(DropReason reason) { bump(dropped[static_cast<std::size_t>(reason)]); }
  /// For a count that only this thread writes: no locked instruction.
  static void bump(Count& count, std::uint64_t by = 1) {
    count.store(count.load(std::memory_order_relaxed) + by, std::memory_order_relaxed);
  }
};

/// What the track thread keeps of a run for its outputs. One thread until the run ends.
struct TrackLog {
  std::vector<StampedPose> causal;  ///< each pose as first published; reserved at start for a log's length
  LatencyHistogram capture_to_pose, track_time;
  Nanoseconds first_pose_ns = 0;  ///< monotonic; 0 = none yet

  /// Takes in one tracking result; `before` is the state of the frame before it.
  void note(const TrackingResult& result, TrackState before, Nanoseconds due_ns, RunCounters& counters);
};

/// What the detector's thread keeps.
struct DetectLog {
  LatencyHistogram run_time;
};

/// What the capture thread keeps.
struct CaptureLog {
  Nanoseconds decode_cpu_ns = 0;
  LatencyHistogram decode_time;
};

}  // namespace stillmap
