// SPDX-License-Identifier: Apache-2.0
#include <pthread.h>
#include <sys/resource.h>

#include <algorithm>
#include <thread>
#include <utility>

#include "core/latest_value.h"
#include "core/spsc_ring.h"
#include "runtime/capture.h"
#include "runtime/health.h"
#include "runtime/heap_count.h"
#include "runtime/run_context.h"
#include "runtime/waker.h"

namespace stillmap {

namespace {

constexpr Nanoseconds kMillisecond = 1'000'000;
// A lost wake would cost this much and no more; a thread that waits sees the wish to stop as often.
constexpr Nanoseconds kIdleWait = 50 * kMillisecond;

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
  Waker decode_waker, capture_waker, track_waker, detect_waker, map_waker;
  std::atomic<bool> detect_end{false}, stream_end{false};
  std::atomic<std::uint64_t> never_due{0};  // frames read ahead of a stop, which nobody gets
};

void name_thread(const char* name) {
  pthread_setname_np(pthread_self(), name);
}

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

/// A log's frames, ahead of their time.
void decode_thread(RunContext& context, Lanes& lanes) {
  name_thread("decode");
  Capture capture(context.driver, context.stages.frames, context.counters, context.capture_log,
                  context.options.duration_s);
  for (bool more = true; more && !context.stop.load(std::memory_order_relaxed);) {
    Lanes::FrameItem item;
    const std::uint32_t ticket = lanes.decode_waker.ticket();
    switch (capture.next(item.frame, 0)) {
      case Capture::Outcome::Frame:
        more = push_waiting(lanes.decoded, std::move(item), lanes.capture_waker, lanes.decode_waker,
                            &context.stop);
        if (!more) lanes.never_due.fetch_add(1, std::memory_order_relaxed);
        break;
      case Capture::Outcome::Nothing:
        // Dropped, and counted; or a frame that waits until the stages have let go of another.
        if (capture.waits_for_room()) lanes.decode_waker.wait(ticket, kMillisecond);
        break;
      default:
        more = false;
    }
  }
  push_waiting(lanes.decoded, Lanes::FrameItem{{}, true}, lanes.capture_waker, lanes.decode_waker,
               &context.stop);
}

/// The next frame of a log, when it has been decoded. False at the end.
bool next_decoded(RunContext& context, Lanes& lanes, FrameHandle& out) {
  while (!context.stop.load(std::memory_order_relaxed)) {
    const std::uint32_t ticket = lanes.capture_waker.ticket();
    if (auto item = lanes.decoded.try_pop()) {
      lanes.decode_waker.wake();
      out = std::move(item->frame);
      return !item->end;
    }
    lanes.capture_waker.wait(ticket, kIdleWait);
  }
  return false;
}

/// Hands a frame to tracker and detector. False on a wish to stop.
bool offer_frame(RunContext& context, Lanes& lanes, FrameHandle frame) {
  FrameHandle for_detector = frame.share();
  if (context.mode == RunMode::Fast) {
    if (!push_waiting(lanes.to_track, Lanes::FrameItem{std::move(frame), false}, lanes.track_waker,
                      lanes.capture_waker, &context.stop)) {
      lanes.never_due.fetch_add(1, std::memory_order_relaxed);
      return false;
    }
  } else if (lanes.to_track.try_push({std::move(frame), false})) {
    lanes.track_waker.wake();
  } else {
    context.counters.drop(DropReason::TrackerBehind);
    return true;
  }
  if (context.detector != nullptr) {
    lanes.to_detect.publish(std::move(for_detector));
    lanes.detect_waker.wake();
  }
  return true;
}

/// A log's frames, each when it is due: on the wall clock, or at once.
void play_log(RunContext& context, Lanes& lanes) {
  Nanoseconds start_ns = 0, first_stamp_ns = 0;
  for (FrameHandle frame; next_decoded(context, lanes, frame);) {
    Nanoseconds due_ns = monotonic_now();
    if (context.mode != RunMode::Fast) {
      if (start_ns == 0) {
        start_ns = due_ns;
        first_stamp_ns = frame->colour_ns;
      }
      due_ns = start_ns + frame->colour_ns - first_stamp_ns;
      while (monotonic_now() < due_ns && !context.stop.load(std::memory_order_relaxed)) {
        lanes.capture_waker.wait(lanes.capture_waker.ticket(), std::min(due_ns - monotonic_now(), kIdleWait));
      }
      if (monotonic_now() < due_ns) {
        lanes.never_due.fetch_add(1, std::memory_order_relaxed);
        return;
      }
    }
    frame.writable().due_ns = due_ns;
    if (!offer_frame(context, lanes, std::move(frame))) return;
  }
}

void play_camera(RunContext& context, Lanes& lanes) {
  Capture capture(context.driver, context.stages.frames, context.counters, context.capture_log,
                  context.options.duration_s);
  while (!context.stop.load(std::memory_order_relaxed)) {
    FrameHandle frame;
    const Capture::Outcome outcome = capture.next(frame, monotonic_now() + 100 * kMillisecond);
    if (outcome == Capture::Outcome::Nothing) continue;
    if (outcome != Capture::Outcome::Frame) {
      context.source_lost = outcome == Capture::Outcome::Lost;
      return;
    }
    offer_frame(context, lanes, std::move(frame));
  }
}

void capture_thread(RunContext& context, Lanes& lanes) {
  name_thread("capture");
  if (context.driver.describe().is_log) {
    play_log(context, lanes);
  } else {
    play_camera(context, lanes);
  }
  push_waiting(lanes.to_track, Lanes::FrameItem{{}, true}, lanes.track_waker, lanes.capture_waker, nullptr);
}

/// The newest frame of the tracker's ring; in fast mode the next. Those that it skips are counted.
FrameHandle next_to_track(RunContext& context, Lanes& lanes, bool& end) {
  FrameHandle newest;
  do {
    if (newest && lanes.to_track.size() > 0) {
      context.counters.drop(DropReason::TrackerBehind);
      newest.reset();  // before the next is taken: capture may need its place
    }
    auto item = lanes.to_track.try_pop();
    if (!item) break;
    lanes.capture_waker.wake();
    end = item->end;
    if (item->frame) newest = std::move(item->frame);
  } while (!end && context.mode != RunMode::Fast);
  return newest;
}

void track_thread(RunContext& context, Lanes& lanes) {
  name_thread("track");
  for (bool end = false; !end;) {
    const std::uint32_t ticket = lanes.track_waker.ticket();
    const FrameHandle frame = next_to_track(context, lanes, end);
    if (!frame) {
      if (!end) lanes.track_waker.wait(ticket, kIdleWait);
      continue;
    }
    if (lanes.boxes_to_track.refresh()) context.stages.track.take_boxes(lanes.boxes_to_track.value());
    if (!track_frame(context, *frame)) continue;
    Lanes::MapItem item;
    context.stages.track.fill_posed(frame, item.posed);
    if (context.mode == RunMode::Fast) {
      push_waiting(lanes.to_map, std::move(item), lanes.map_waker, lanes.track_waker, nullptr);
    } else if (lanes.to_map.try_push(std::move(item))) {
      lanes.map_waker.wake();
    }
  }
  lanes.detect_end.store(true, std::memory_order_release);
  lanes.detect_waker.wake();
  push_waiting(lanes.to_map, Lanes::MapItem{{}, true}, lanes.map_waker, lanes.track_waker, nullptr);
}

void detect_thread(RunContext& context, Lanes& lanes) {
  name_thread("detect");
  setpriority(PRIO_PROCESS, 0, 10);  // of this thread alone: the last to get a core that is short
  while (!lanes.detect_end.load(std::memory_order_acquire)) {
    const std::uint32_t ticket = lanes.detect_waker.ticket();
    if (!lanes.to_detect.refresh()) {
      lanes.detect_waker.wait(ticket, kIdleWait);
      continue;
    }
    DetectedFrame detected;
    detected.frame = std::move(lanes.to_detect.value());
    if (!detect_frame(context, *detected.frame, detected.boxes)) continue;
    lanes.boxes_to_track.publish(detected.boxes);
    if (lanes.boxes_to_map.try_push(std::move(detected))) lanes.map_waker.wake();
  }
  lanes.to_detect.refresh();
  lanes.to_detect.value().reset();
}

void map_thread(RunContext& context, Lanes& lanes) {
  name_thread("map");
  const HeapScope scope(HeapOwner::Map);
  std::optional<DetectedFrame> held;  // its frame has not come from the tracker yet
  std::uint64_t newest = 0;
  for (bool end = false; !end;) {
    const std::uint32_t ticket = lanes.map_waker.ticket();
    bool idle = true;
    while (auto item = lanes.to_map.try_pop()) {
      lanes.track_waker.wake();
      idle = false;
      end |= item->end;
      if (!item->posed.frame) continue;
      newest = item->posed.frame->sequence;
      context.stages.map.take_frame(std::move(item->posed));
    }
    if (!held) held = lanes.boxes_to_map.try_pop();
    if (held && (held->frame->sequence <= newest || end)) {
      context.stages.map.take_detected(std::move(*held));
      held.reset();
      idle = false;
    }
    context.counters.blocks.note(context.stages.map.map().usage());
    if (context.stages.stream) context.stages.map.answer_cloud_request(*context.stages.stream);
    if (idle && !end) lanes.map_waker.wait(ticket, kIdleWait);
  }
}

void stream_thread(RunContext& context, Lanes& lanes) {
  name_thread("stream");
  const HeapScope scope(HeapOwner::Stream);
  while (!lanes.stream_end.load(std::memory_order_acquire)) context.stages.stream->service(20);
}

}  // namespace

void run_threads(RunContext& context) {
  Lanes lanes;
  Health health(context);
  std::atomic<bool> work_done{false};
  std::thread stream;
  if (context.stages.stream) stream = std::thread([&] { stream_thread(context, lanes); });
  std::thread map([&] { map_thread(context, lanes); });
  std::thread detect;
  if (context.detector != nullptr) detect = std::thread([&] { detect_thread(context, lanes); });
  std::thread track([&] { track_thread(context, lanes); });
  std::thread decode;
  if (context.driver.describe().is_log) decode = std::thread([&] { decode_thread(context, lanes); });
  std::thread capture([&] {
    capture_thread(context, lanes);
    work_done.store(true, std::memory_order_release);
  });
  Waker idle;
  while (!work_done.load(std::memory_order_acquire)) {
    health.tick();
    idle.wait(idle.ticket(), 100 * kMillisecond);
  }
  if (decode.joinable()) decode.join();
  capture.join();
  track.join();
  if (detect.joinable()) detect.join();
  map.join();
  while (auto item = lanes.decoded.try_pop()) lanes.never_due += item->frame ? 1 : 0;
  context.counters.offered -= lanes.never_due;
  // What the detector finished after the map had ended is let go of here, with the lanes.
  lanes.stream_end.store(true, std::memory_order_release);
  if (stream.joinable()) stream.join();
  health.finish();
}

}  // namespace stillmap
