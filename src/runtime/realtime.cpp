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

/// The threads' shared part. Frames go capture -> track -> map through rings in which every item counts; the
/// detector sees the newest frame only. The end of the stream travels as an item of its own behind the last
/// frame, so each thread ends after its last work.
struct Lanes {
  struct FrameItem {
    FrameHandle frame;
    bool end = false;
  };
  struct MapItem {
    PosedFrame posed;
    bool end = false;
  };
  SpscRing<FrameItem, 2> to_track;
  LatestValue<FrameHandle> to_detect;
  LatestValue<Detections> boxes_to_track;
  SpscRing<DetectedFrame, 2> boxes_to_map;
  SpscRing<MapItem, 2> to_map;
  Waker track_waker, detect_waker, map_waker, capture_waker;
  std::atomic<bool> detect_end{false}, stream_end{false};
};

void name_thread(const char* name) {
  pthread_setname_np(pthread_self(), name);
}

template <class Ring>
void push_end(Ring& ring, Waker& consumer, Waker& self) {
  while (!ring.try_push({{}, true})) self.wait(self.ticket(), kMillisecond);
  consumer.wake();
}

void capture_thread(RunContext& context, Lanes& lanes) {
  name_thread("capture");
  Capture capture(context.driver, context.config.camera, context.stages.frames, context.counters,
                  context.capture_log, context.options.duration_s);
  const bool paced = context.driver.describe().is_log;
  Nanoseconds start_ns = 0, first_stamp_ns = 0;
  while (!context.stop.load(std::memory_order_relaxed)) {
    FrameHandle frame;
    const Capture::Outcome outcome = capture.next(frame, monotonic_now() + 100 * kMillisecond);
    if (outcome == Capture::Outcome::Nothing) {
      if (paced) lanes.capture_waker.wait(lanes.capture_waker.ticket(), kMillisecond);
      continue;
    }
    if (outcome != Capture::Outcome::Frame) {
      context.source_lost = outcome == Capture::Outcome::Lost;
      break;
    }
    if (start_ns == 0) {
      start_ns = monotonic_now();
      first_stamp_ns = frame->colour_ns;
    }
    if (paced) {
      // The log plays on the wall clock: the frame was decoded ahead and is due now.
      const Nanoseconds due_ns = start_ns + frame->colour_ns - first_stamp_ns;
      frame.writable().due_ns = due_ns;
      while (monotonic_now() < due_ns && !context.stop.load(std::memory_order_relaxed)) {
        lanes.capture_waker.wait(lanes.capture_waker.ticket(), std::min(due_ns - monotonic_now(), kIdleWait));
      }
    }
    if (context.record != nullptr) context.record->offer(frame);
    FrameHandle for_detector = frame.share();
    if (!lanes.to_track.try_push({std::move(frame), false})) {
      context.counters.drop(DropReason::TrackerBehind);
      continue;
    }
    lanes.track_waker.wake();
    if (context.detector != nullptr) {
      lanes.to_detect.publish(std::move(for_detector));
      lanes.detect_waker.wake();
    }
  }
  push_end(lanes.to_track, lanes.track_waker, lanes.capture_waker);
}

void track_thread(RunContext& context, Lanes& lanes) {
  name_thread("track");
  for (bool end = false; !end;) {
    const std::uint32_t ticket = lanes.track_waker.ticket();
    FrameHandle newest;
    while (auto item = lanes.to_track.try_pop()) {
      end |= item->end;
      if (!item->frame) continue;
      if (newest) context.counters.drop(DropReason::TrackerBehind);
      newest = std::move(item->frame);
    }
    if (newest) {
      if (lanes.boxes_to_track.refresh()) context.stages.track.take_boxes(lanes.boxes_to_track.value());
      if (track_frame(context, *newest)) {
        Lanes::MapItem item;
        context.stages.track.fill_posed(newest, item.posed);
        if (lanes.to_map.try_push(std::move(item))) lanes.map_waker.wake();
      }
    } else if (!end) {
      lanes.track_waker.wait(ticket, kIdleWait);
    }
  }
  lanes.detect_end.store(true, std::memory_order_release);
  lanes.detect_waker.wake();
  push_end(lanes.to_map, lanes.map_waker, lanes.track_waker);
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

void run_realtime(RunContext& context) {
  Lanes lanes;
  Health health(context);
  std::atomic<bool> work_done{false};
  std::thread stream;
  if (context.stages.stream) stream = std::thread([&] { stream_thread(context, lanes); });
  std::thread map([&] { map_thread(context, lanes); });
  std::thread detect;
  if (context.detector != nullptr) detect = std::thread([&] { detect_thread(context, lanes); });
  std::thread track([&] { track_thread(context, lanes); });
  std::thread capture([&] {
    capture_thread(context, lanes);
    work_done.store(true, std::memory_order_release);
  });
  Waker idle;
  while (!work_done.load(std::memory_order_acquire)) {
    health.tick();
    idle.wait(idle.ticket(), 100 * kMillisecond);
  }
  capture.join();
  track.join();
  if (detect.joinable()) detect.join();
  map.join();
  // What the detector finished after the map had ended is let go of here, with the lanes.
  lanes.stream_end.store(true, std::memory_order_release);
  if (stream.joinable()) stream.join();
  health.finish();
}

}  // namespace stillmap
