// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <span>

#include "core/event.h"
#include "core/fixed_vector.h"
#include "core/tracking_result.h"
#include "eval/trajectory.h"
#include "runtime/latency.h"
#include "runtime/threads.h"

namespace stillmap {

/// A pool's usage as its thread last noted it, for other threads to read.
struct PoolMark {
  std::atomic<const char*> name{nullptr};  ///< null: not noted yet
  std::atomic<std::uint64_t> capacity{0}, high_water{0}, refused{0};

  void note(const PoolUsage& usage) {
    capacity.store(usage.capacity, std::memory_order_relaxed);
    high_water.store(usage.high_water, std::memory_order_relaxed);
    refused.store(usage.refused, std::memory_order_relaxed);
    name.store(usage.name, std::memory_order_release);
  }
};

/// Counts of a run. Each is written by one thread, but for `dropped`, and may be read by any.
struct RunCounters {
  using Count = std::atomic<std::uint64_t>;
  Count offered{0}, processed{0};
  std::array<Count, kDropReasonCount> dropped{};
  Count initializing{0}, tracked{0}, weak{0}, lost{0}, relocalized{0}, segments{0}, keyframes{0},
      corrections{0};
  Count static_features{0}, dynamic_features{0}, semi_static_features{0}, unknown_features{0};
  Count detector_runs{0}, detector_failures{0}, detector_skipped{0};
  Count quality_lowered{0}, quality_raised{0}, frames_shed{0};
  Count held_back_ns{0};  ///< realtime: a log's frames came so much later, since decoding was slow
  Count latency_us{0};    ///< capture to pose, sum over all poses
  Count recorded{0}, record_failed{0}, record_left_out{0}, record_cpu_ns{0};  ///< of --record
  std::array<Count, kStageCount> late{};                                      ///< how often each stage was
  std::atomic<int> state{0};                                                  ///< TrackState
  PoolMark points, keyframe_pool, blocks;
  PoolMark read_ahead, track_ring, map_ring, detected_ring;  ///< where there are threads

  std::array<PoolMark, kThreadRoles> stacks;  ///< in bytes, of threads that have ended

  /// Calls fn(usage) for each that has been noted.
  template <class F>
  void for_each_pool(F&& fn) const {
    const auto tell = [&](const PoolMark& mark) {
      const char* name = mark.name.load(std::memory_order_acquire);
      if (name != nullptr)
        fn(PoolUsage{name, mark.capacity.load(), mark.high_water.load(), mark.refused.load()});
    };
    for (const PoolMark* mark :
         {&points, &keyframe_pool, &blocks, &read_ahead, &track_ring, &map_ring, &detected_ring})
      tell(*mark);
    for (const PoolMark& mark : stacks) tell(mark);
  }

  /// Frames with a pose.
  std::uint64_t posed() const {
    return tracked.load(std::memory_order_relaxed) + weak.load(std::memory_order_relaxed);
  }
  /// Capture and tracker both drop frames that the tracker is too late for.
  void drop(DropReason reason) {
    dropped[static_cast<std::size_t>(reason)].fetch_add(1, std::memory_order_relaxed);
  }
  std::uint64_t dropped_for(DropReason reason) const {
    return dropped[static_cast<std::size_t>(reason)].load(std::memory_order_relaxed);
  }
  /// For a count that only this thread writes: no locked instruction.
  static void bump(Count& count, std::uint64_t by = 1) {
    count.store(count.load(std::memory_order_relaxed) + by, std::memory_order_relaxed);
  }
};

/// What the track thread keeps of a run for its outputs. One thread until the run ends.
struct TrackLog {
  TrackLog(std::span<StampedPose> room, std::span<std::array<double, 36>> covariance_room)
      : causal(room), covariances(covariance_room) {}

  ArenaVector<StampedPose> causal;  ///< each pose as first published, as far as there is room
  ArenaVector<std::array<double, 36>>
      covariances;  ///< of those poses, where ground truth is there to compare
  LatencyHistogram capture_to_pose, track_time, track_cpu_time;
  Nanoseconds first_pose_ns = 0;  ///< monotonic; 0 = none yet

  /// Takes in one tracking result; `before` is the state of the frame before it.
  void note(const TrackingResult& result, TrackState before, Nanoseconds due_ns, RunCounters& counters);
};

/// What the capture thread keeps.
struct CaptureLog {
  Nanoseconds decode_cpu_ns = 0;
  LatencyHistogram decode_time;
  LatencyHistogram stamp_to_slot;  ///< of a camera whose stamps are on the monotonic clock
};

}  // namespace stillmap
