// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <utility>

#include "runtime/lanes.h"

namespace stillmap {

namespace {

/// The next frame of a log, when it has been decoded. False at the end.
bool next_decoded(RunContext& context, Lanes& lanes, FrameHandle& out) {
  const AtWork waiting(context, Stage::Capture);
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
  const bool patient = context.mode == RunMode::Fast;
  if (context.record != nullptr)
    patient ? context.record->offer_patiently(frame) : context.record->offer(frame);
  if (patient) {
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
  const int every = quality_now(context).detector_every;
  if (context.detector != nullptr && for_detector->sequence % static_cast<std::uint64_t>(every) == 0) {
    lanes.to_detect.publish(std::move(for_detector));
    lanes.detect_waker.wake();
  }
  return true;
}

/// A log's frames, each when it is due: on the wall clock, or at once. A camera decodes nothing: where
/// decoding is too slow for the clock, the clock is held back, and nobody is late for it.
void play_log(RunContext& context, Lanes& lanes) {
  const auto frame_ns = static_cast<Nanoseconds>(1e9 / context.config.mount.fps);
  Nanoseconds start_ns = 0, first_stamp_ns = 0;
  for (FrameHandle frame; next_decoded(context, lanes, frame);) {
    const Nanoseconds decoded_ns = frame->due_ns;
    Nanoseconds due_ns = monotonic_now();
    if (context.mode != RunMode::Fast) {
      if (start_ns == 0) {
        start_ns = due_ns;
        first_stamp_ns = frame->colour_ns;
      }
      due_ns = start_ns + frame->colour_ns - first_stamp_ns;
      if (const Nanoseconds late_ns = decoded_ns - due_ns; late_ns > frame_ns) {
        start_ns += late_ns;
        RunCounters::bump(context.counters.held_back_ns, static_cast<std::uint64_t>(late_ns));
      }
      due_ns = std::max(due_ns, decoded_ns);
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
  Capture capture = context.capture();
  for (;;) {
    FrameHandle frame;
    {
      const AtWork waiting(context, Stage::Capture);
      Capture::Outcome outcome = Capture::Outcome::Nothing;
      while (outcome == Capture::Outcome::Nothing) {
        if (context.stop.load(std::memory_order_relaxed)) return;
        outcome = capture.next(frame, monotonic_now() + 100 * kMillisecond);
      }
      context.source_lost = outcome == Capture::Outcome::Lost;
      if (outcome != Capture::Outcome::Frame) return;
    }
    offer_frame(context, lanes, std::move(frame));
  }
}

}  // namespace

void decode_thread(RunContext& context, Lanes& lanes) {
  Capture capture = context.capture();
  for (bool more = true; more && !context.stop.load(std::memory_order_relaxed);) {
    Lanes::FrameItem item;
    const std::uint32_t ticket = lanes.decode_waker.ticket();
    const Capture::Outcome outcome = capture.next(item.frame, 0);
    switch (outcome) {
      case Capture::Outcome::Frame:
        more = push_waiting(lanes.decoded, std::move(item), lanes.capture_waker, lanes.decode_waker,
                            &context.stop);
        if (!more) lanes.never_due.fetch_add(1, std::memory_order_relaxed);
        break;
      case Capture::Outcome::Nothing:
        // Dropped, and counted; or waiting until the stages have let go of a frame.
        if (capture.waits_for_room()) lanes.decode_waker.wait(ticket, kMillisecond);
        break;
      default:
        context.source_lost = outcome == Capture::Outcome::Lost;
        more = false;
    }
  }
  push_waiting(lanes.decoded, Lanes::FrameItem{{}, true}, lanes.capture_waker, lanes.decode_waker,
               &context.stop);
}

void capture_thread(RunContext& context, Lanes& lanes) {
  if (context.driver.describe().is_log) {
    play_log(context, lanes);
  } else {
    play_camera(context, lanes);
  }
  push_waiting(lanes.to_track, Lanes::FrameItem{{}, true}, lanes.track_waker, lanes.capture_waker, nullptr);
  lanes.capture_done.store(true, std::memory_order_release);
  lanes.main_waker.wake();
}

}  // namespace stillmap
