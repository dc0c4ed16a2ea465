// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>

#include "core/config.h"
#include "core/event.h"
#include "detect/detector.h"
#include "drivers/rgbd_driver.h"
#include "runtime/record_lane.h"
#include "runtime/run_options.h"
#include "runtime/run_state.h"
#include "runtime/stages.h"

namespace stillmap {

/// Everything a running pipeline works with; owned by `run`. Both modes drive the same stages through it.
struct RunContext {
  RunContext(const Config& c, const RunOptions& o, RgbdDriver& d, Detector* n, Stages& s,
             const std::atomic<bool>& stopping)
      : config(c), options(o), driver(d), detector(n), stages(s), stop(stopping) {}

  const Config& config;
  const RunOptions& options;
  RgbdDriver& driver;
  Detector* detector;  ///< null: none
  Stages& stages;
  const std::atomic<bool>& stop;  ///< set by a signal

  RunCounters counters;
  TrackLog track_log;
  CaptureLog capture_log;
  DetectLog detect_log;
  std::array<EventRing, kStageCount> events;
  RecordLane* record = nullptr;        ///< null: nothing is recorded
  EventRing* source_events = nullptr;  ///< a camera's own, told on capture's thread; null: none
  bool source_lost = false;            ///< written by capture, read when the run has ended

  EventRing& events_of(Stage stage) { return events[static_cast<std::size_t>(stage)]; }
};

/// One frame through tracking, with its counts, events and stream: what both modes do on their track thread.
/// True when the frame has a pose.
bool track_frame(RunContext& context, const FrameSlot& frame);

/// One frame through the detector; false when it failed (counted).
bool detect_frame(RunContext& context, const FrameSlot& frame, Detections& out);

/// Deterministic, on the calling thread, until the source ends or `stop`.
void run_lockstep(RunContext& context);
/// One thread per stage, on the wall clock, until the source ends or `stop`.
void run_realtime(RunContext& context);

}  // namespace stillmap
