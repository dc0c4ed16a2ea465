// SPDX-License-Identifier: Apache-2.0
#include "runtime/run_state.h"

#include <algorithm>

namespace stillmap {

void TrackLog::note(const TrackingResult& result, TrackState before, Nanoseconds due_ns,
                    RunCounters& counters) {
  using C = RunCounters;
  const Nanoseconds now = monotonic_now();
  C::bump(counters.processed);
  counters.state.store(static_cast<int>(result.state), std::memory_order_relaxed);
  C::bump(counters.static_features, result.labels.static_points);
  C::bump(counters.dynamic_features, result.labels.dynamic);
  C::bump(counters.semi_static_features, result.labels.semi_static);
  C::bump(counters.unknown_features, result.labels.unknown);
  if (result.is_keyframe) C::bump(counters.keyframes);
  counters.corrections.store(result.correction_epoch, std::memory_order_relaxed);
  if (result.state == TrackState::Initializing) C::bump(counters.initializing);
  if (result.state == TrackState::Lost) C::bump(counters.lost);
  if (!result.has_pose()) return;
  C::bump(result.state == TrackState::Tracking ? counters.tracked : counters.weak);
  const bool new_segment = result.segment != counters.segments.load(std::memory_order_relaxed);
  if (new_segment) C::bump(counters.segments);
  if (before == TrackState::Lost && !new_segment) C::bump(counters.relocalized);
  if (first_pose_ns == 0) first_pose_ns = now;
  capture_to_pose.add(now - due_ns);
  C::bump(counters.latency_us, static_cast<std::uint64_t>(std::max<Nanoseconds>(now - due_ns, 0) / 1000));
  if (causal.capacity() > 0)
    static_cast<void>(causal.try_push_back({result.stamp_ns, result.T_map_camera()}));
  if (covariances.capacity() > 0) static_cast<void>(covariances.try_push_back(result.covariance));
}

}  // namespace stillmap
