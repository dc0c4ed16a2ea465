// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <functional>

#include "core/config.h"
#include "core/event.h"
#include "core/whole_file.h"
#include "detect/detector.h"
#include "drivers/rgbd_driver.h"
#include "runtime/capture.h"
#include "runtime/flight_recorder.h"
#include "runtime/load_shedder.h"
#include "runtime/record_lane.h"
#include "runtime/reopening_source.h"
#include "runtime/run_options.h"
#include "runtime/run_state.h"
#include "runtime/stages.h"
#include "runtime/watchdog.h"

namespace stillmap {

/// Everything a running pipeline works with; owned by `run`. Every mode drives the same stages through it.
struct RunContext {
  RunContext(const Config& c, const RunOptions& o, RunMode m, RgbdDriver& d, Detector* n, Stages& s,
             const std::atomic<bool>& stopping)
      : config(c),
        options(o),
        mode(m),
        driver(d),
        detector(n),
        stages(s),
        stop(stopping),
        track_log(s.trajectory, s.covariances),
        shedder(static_cast<Nanoseconds>(1e9 / c.mount.fps)),
        flight(s.flight, c.runtime.flight_recorder) {}

  const Config& config;
  const RunOptions& options;
  const RunMode mode;
  RgbdDriver& driver;
  Detector* detector;  ///< null: none
  Stages& stages;
  const std::atomic<bool>& stop;  ///< set by a signal

  RunCounters counters;
  TrackLog track_log;
  CaptureLog capture_log;
  LatencyHistogram adjust_time, detect_time;  ///< each of its own thread
  std::array<EventRing, kStageCount> events;
  Watchdog watchdog;
  std::uint32_t epoch_passed = 0, segment_told = 0;  ///< the track thread's
  LoadShedder shedder;                               ///< the track thread's
  std::atomic<int> quality{0};                       ///< the shedder's step, for every stage
  FlightRecorder flight;
  std::function<void(Stage)> on_work;  ///< tests hold a stage up with it; empty in a run
  RecordLane* record = nullptr;        ///< null: nothing is recorded
  SourceNews* source_news = nullptr;   ///< a camera's; null: none
  EarlierFile earlier_map;             ///< the health thread's, then that of the outputs
  bool source_lost = false;            ///< written by capture, read when the run has ended

  /// A full ring counts what it refuses.
  void emit(Stage stage, EventCode code, std::uint64_t sequence, std::int64_t a) {
    static_cast<void>(events_of(stage).try_push({monotonic_now(), stage, code, sequence, a}));
  }
  /// For the one thread that takes frames from the driver.
  Capture capture() {
    return {driver,
            config.camera,
            stages.frames,
            counters,
            capture_log,
            events_of(Stage::Capture),
            options.duration_s};
  }
  EventRing& events_of(Stage stage) { return events[static_cast<std::size_t>(stage)]; }
};

/// One frame through tracking, with its counts, events and stream: what every mode does on its track thread.
/// True when the frame may enter the map.
bool track_frame(RunContext& context, const FrameSlot& frame);

/// The local map's adjustment, where one waits: what every mode does beside its track thread.
void adjust_map(RunContext& context);

/// What is given up now.
inline const Quality& quality_now(const RunContext& context) {
  return kSheddingPlan[static_cast<std::size_t>(context.quality.load(std::memory_order_relaxed))];
}

/// A stage is at work while this lives, which the watchdog times.
class AtWork {
 public:
  AtWork(RunContext& context, Stage stage) : context_(context), stage_(stage) {
    context_.watchdog.begin(stage_, monotonic_now());
    if (context_.on_work) context_.on_work(stage_);
  }
  ~AtWork() { context_.watchdog.end(stage_); }
  AtWork(const AtWork&) = delete;
  AtWork& operator=(const AtWork&) = delete;

 private:
  RunContext& context_;
  Stage stage_;
};

/// Track thread, after each frame: gives up quality when frames come late, and takes it back. `lost_frames`:
/// some were dropped for want of time since the last call.
void adapt_quality(RunContext& context, const FrameSlot& frame, bool lost_frames);

/// One frame through the detector; false when it failed (counted).
bool detect_frame(RunContext& context, const FrameSlot& frame, Detections& out);

/// Lets the stream's preview have a frame, when it is due: one that was detected on, with its own boxes, or
/// one that was tracked. Without a detector nobody knows whether there are people in it: then only where they
/// may be seen.
void offer_picture(RunContext& context, const FrameSlot& frame, const Detections& own);

/// Map thread. Gives the stream's clients what they wait for of the map.
void answer_map_requests(RunContext& context);

/// Deterministic, on the calling thread, until the source ends or `stop`.
void run_lockstep(RunContext& context);
/// One thread per stage, in every other mode, until the source ends or `stop`.
void run_threads(RunContext& context);

}  // namespace stillmap
