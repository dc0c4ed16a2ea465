// SPDX-License-Identifier: Apache-2.0
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "runtime/health.h"
#include "runtime/heap_count.h"
#include "runtime/lanes.h"
#include "runtime/threads.h"

namespace stillmap {

namespace {

/// The newest frame of the tracker's ring; in fast mode the next. Those that it skips are counted. The end of
/// the stream takes nobody's place.
FrameHandle next_to_track(RunContext& context, Lanes& lanes, bool& end) {
  FrameHandle newest;
  while (!end && !(newest && context.mode == RunMode::Fast)) {
    const Lanes::FrameItem* next = lanes.to_track.front();
    if (next == nullptr) break;
    if (newest && !next->end) {
      context.counters.drop(DropReason::TrackerBehind);
      newest.reset();  // before the next is taken: capture may need its place
    }
    auto item = lanes.to_track.try_pop();
    lanes.capture_waker.wake();
    end = item->end;
    if (item->frame) newest = std::move(item->frame);
  }
  return newest;
}

void track_thread(RunContext& context, Lanes& lanes) {
  const auto max_age_ns = static_cast<Nanoseconds>(context.config.detector.max_age_ms) * 1'000'000;
  std::uint64_t behind_before = 0;
  Nanoseconds heard_ns = 0;  // stamp of the newest frame that the detector has spoken of
  for (bool end = false; !end;) {
    const std::uint32_t ticket = lanes.track_waker.ticket();
    const FrameHandle frame = next_to_track(context, lanes, end);
    if (!frame) {
      if (!end) lanes.track_waker.wait(ticket, kIdleWait);
      continue;
    }
    Lanes::MapItem item;
    bool posed = false;
    {
      const AtWork working(context, Stage::Track);
      if (lanes.boxes_to_track.refresh()) {
        context.stages.track.take_boxes(lanes.boxes_to_track.value());
        heard_ns = lanes.boxes_to_track.value().stamp_ns;
      }
      posed = track_frame(context, *frame);
      if (posed) context.stages.track.fill_posed(frame, item.posed);
      // While the detector speaks, the map has its frames from there.
      const bool silent = frame->colour_ns - heard_ns > max_age_ns;
      if (context.detector != nullptr && !silent && !item.posed.boxes_are_its_own) item.posed.frame.reset();
      if (context.stages.track.work_waits()) lanes.adjust_waker.wake();
      if (context.detector == nullptr) offer_picture(context, *frame, {});
    }
    bool fits = true;
    if (posed && context.mode == RunMode::Fast) {
      push_waiting(lanes.to_map, std::move(item), lanes.map_waker, lanes.track_waker, nullptr);
    } else if (posed) {
      fits = lanes.to_map.try_push(std::move(item));
      lanes.map_waker.wake();
    }
    const std::uint64_t behind = context.counters.dropped_for(DropReason::TrackerBehind);
    if (context.mode != RunMode::Fast) adapt_quality(context, *frame, !fits || behind != behind_before);
    behind_before = behind;
  }
  lanes.workers_end.store(true, std::memory_order_release);
  lanes.adjust_waker.wake();
  lanes.detect_waker.wake();
  push_waiting(lanes.to_map, Lanes::MapItem{{}, true}, lanes.map_waker, lanes.track_waker, nullptr);
}

void adjust_thread(RunContext& context, Lanes& lanes) {
  while (!lanes.workers_end.load(std::memory_order_acquire)) {
    const std::uint32_t ticket = lanes.adjust_waker.ticket();
    if (!context.stages.track.work_waits()) {
      lanes.adjust_waker.wait(ticket, kIdleWait);
      continue;
    }
    const AtWork working(context, Stage::Adjust);
    adjust_map(context);
  }
}

void detect_thread(RunContext& context, Lanes& lanes) {
  while (!lanes.workers_end.load(std::memory_order_acquire)) {
    const std::uint32_t ticket = lanes.detect_waker.ticket();
    if (!lanes.to_detect.refresh()) {
      lanes.detect_waker.wait(ticket, kIdleWait);
      continue;
    }
    const AtWork working(context, Stage::Detect);
    DetectedFrame detected;
    detected.frame = std::move(lanes.to_detect.value());
    if (!detect_frame(context, *detected.frame, detected.boxes)) continue;
    lanes.boxes_to_track.publish(detected.boxes);
    offer_picture(context, *detected.frame, detected.boxes);
    if (lanes.boxes_to_map.try_push(std::move(detected))) lanes.map_waker.wake();
  }
  lanes.to_detect.refresh();
  lanes.to_detect.value().reset();
}

void map_thread(RunContext& context, Lanes& lanes) {
  const HeapScope scope(HeapOwner::Map);
  std::optional<DetectedFrame> held;  // its frame has not come from the tracker yet
  std::uint64_t newest = 0;
  for (bool end = false; !end;) {
    const std::uint32_t ticket = lanes.map_waker.ticket();
    bool idle = true;
    context.stages.map.set_fuse_factor(quality_now(context).fuse_factor);
    // One at a time: where the tracker is faster there is always another, and the rest of this loop has its
    // turn, too.
    if (auto item = lanes.to_map.try_pop()) {
      lanes.track_waker.wake();
      idle = false;
      end = item->end;
      if (!end) {
        const AtWork working(context, Stage::Map);
        newest = item->posed.sequence;
        context.stages.map.take_frame(std::move(item->posed));
      }
    }
    if (!held) held = lanes.boxes_to_map.try_pop();
    if (held && (held->frame->sequence <= newest || end)) {
      const AtWork working(context, Stage::Map);
      context.stages.map.take_detected(std::move(*held));
      held.reset();
      idle = false;
    }
    context.stages.map.serve_checkpoint();
    context.counters.blocks.note(context.stages.map.map().usage());
    if (context.stages.stream) {
      const AtWork working(context, Stage::Map);
      answer_map_requests(context);
    }
    if (idle && !end) lanes.map_waker.wait(ticket, kIdleWait);
  }
}

void stream_thread(RunContext& context, Lanes& lanes) {
  const HeapScope scope(HeapOwner::Stream);
  while (!lanes.stream_end.load(std::memory_order_acquire)) {
    const AtWork working(context, Stage::Stream);
    context.stages.stream->service(20);
  }
}

void note_rings(RunContext& context, const Lanes& lanes) {
  context.counters.read_ahead.note(lanes.decoded.usage("read_ahead"));
  context.counters.track_ring.note(lanes.to_track.usage("track_ring"));
  context.counters.map_ring.note(lanes.to_map.usage("map_ring"));
  context.counters.detected_ring.note(lanes.boxes_to_map.usage("detected_ring"));
}

}  // namespace

void run_threads(RunContext& context) {
  Lanes lanes;
  Health health(context);
  std::vector<std::string> warnings;
  const Config::Threads usable = usable_threads(context.config.threads, warnings);
  for (const std::string& warning : warnings) health.warn(warning);
  StageThread decode, capture, track, adjust, detect, map, stream;
  const auto start = [&](StageThread& thread, ThreadRole role, void (*body)(RunContext&, Lanes&)) {
    thread.start(role, usable, context.config.memory.lock,
                 [&context, &lanes, body] { body(context, lanes); });
  };
  if (context.stages.stream) start(stream, ThreadRole::Stream, stream_thread);
  start(map, ThreadRole::Map, map_thread);
  if (context.detector != nullptr) start(detect, ThreadRole::Detect, detect_thread);
  start(adjust, ThreadRole::Adjust, adjust_thread);
  start(track, ThreadRole::Track, track_thread);
  start(capture, ThreadRole::Capture, capture_thread);
  if (context.driver.describe().is_log) start(decode, ThreadRole::Decode, decode_thread);
  health.ready();
  while (!lanes.capture_done.load(std::memory_order_acquire)) {
    note_rings(context, lanes);
    health.tick();
    const std::uint32_t ticket = lanes.main_waker.ticket();
    if (!lanes.capture_done.load(std::memory_order_acquire))
      lanes.main_waker.wait(ticket, 100 * kMillisecond);
  }
  health.stopping();
  auto join = [&, stack = context.counters.stacks.begin()](StageThread& thread) mutable {
    thread.join();
    if (const PoolUsage usage = thread.stack_usage(); usage.high_water > 0) stack++->note(usage);
  };
  join(decode);
  join(capture);
  join(track);
  join(adjust);
  join(detect);
  join(map);
  while (auto item = lanes.decoded.try_pop()) lanes.never_due += item->frame ? 1 : 0;
  context.counters.offered -= lanes.never_due;
  context.counters.detector_skipped = lanes.to_detect.displaced();
  note_rings(context, lanes);
  // What the detector finished after the map had ended is let go of here, with the lanes.
  lanes.stream_end.store(true, std::memory_order_release);
  join(stream);
  health.finish();
}

}  // namespace stillmap
