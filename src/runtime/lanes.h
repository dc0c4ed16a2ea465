// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <utility>

#include "core/latest_value.h"
#include "core/spsc_ring.h"
#include "runtime/run_context.h"
#include "runtime/waker.h"

namespace stillmap {

constexpr Nanoseconds kMillisecond = 1'000'000;

/// The threads' shared part. Frames go (decode ->) capture -> track -> map through rings in which every item
/// counts; the detector sees the newest frame only. The end of the stream travels as an item of its own
/// behind the last frame, so each thread ends after its last work. In fast mode who comes to a full ring
/// waits for room; otherwise nobody waits, and what finds no room is dropped and counted.
struct Lanes {
  struct FrameItem {
    FrameHandle frame;
    bool end = false;
  };
  struct MapItem {
    PosedFrame posed;
    bool end = false;
  };
  SpscRing<FrameItem, kReadAheadRing> decoded;
  SpscRing<FrameItem, kTrackRing> to_track;
  LatestValue<FrameHandle> to_detect;
  LatestValue<Detections> boxes_to_track;
  SpscRing<DetectedFrame, kDetectedRing> boxes_to_map;
  SpscRing<MapItem, kMapRing> to_map;
  Waker decode_waker, capture_waker, track_waker, adjust_waker, detect_waker, map_waker, main_waker;
  std::atomic<bool> capture_done{false}, workers_end{false}, stream_end{false};
  std::atomic<std::uint64_t> never_due{0};  // frames read ahead of a stop, which nobody gets
};

/// Pushes when there is room; who takes from the ring wakes `self`. False, without a push, on a wish to stop.
template <class Ring, class Item>
bool push_waiting(Ring& ring, Item&& item, Waker& consumer, Waker& self, const std::atomic<bool>* stop) {
  for (;;) {
    const std::uint32_t ticket = self.ticket();
    if (ring.size() < Ring::capacity()) break;
    if (stop != nullptr && stop->load(std::memory_order_relaxed)) return false;
    self.wait(ticket, kIdleWait);
  }
  STILLMAP_CHECK(ring.try_push(std::forward<Item>(item)));
  consumer.wake();
  return true;
}

/// Bodies of the threads that feed the rest: one decodes a log's frames ahead of their time, the other hands
/// a log's or a camera's frames to tracker and detector when they are due, and ends the stream behind the
/// last.
void decode_thread(RunContext& context, Lanes& lanes);
void capture_thread(RunContext& context, Lanes& lanes);

}  // namespace stillmap
