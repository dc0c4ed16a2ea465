// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <string>
#include <thread>

#include "core/config.h"
#include "core/frame_pool.h"
#include "core/spsc_ring.h"
#include "drivers/recorder/recorder.h"
#include "runtime/run_state.h"
#include "runtime/waker.h"

namespace stillmap {

/// Takes frames from capture to the recorder on a thread of its own. Frames that wait for the disk are held
/// in the pool, `capacity` at most; where the disk is slower for longer than that, frames are left out of the
/// log and counted. Capture never waits, but in lockstep.
class RecordLane {
 public:
  RecordLane(Recorder& recorder, int capacity, RunCounters& counters);
  ~RecordLane();
  RecordLane(const RecordLane&) = delete;
  RecordLane& operator=(const RecordLane&) = delete;

  /// Capture's thread. Shares the frame into the log, or counts it as left out.
  void offer(const FrameHandle& frame);
  /// The same, but waits for a place.
  void offer_patiently(const FrameHandle& frame);
  /// Writes what waits, and ends the thread.
  void finish();

  /// Frames of the pool that a lane of this capacity may hold: those that wait, and the one being written.
  static int frames_held(int capacity) { return capacity + 1; }

 private:
  bool has_place() const { return waiting_.size() < capacity_; }
  void push(const FrameHandle& frame);
  void write_all();

  Recorder& recorder_;
  std::size_t capacity_;
  RunCounters& counters_;
  SpscRing<FrameHandle, 32> waiting_;
  Waker work_waker_, place_waker_;
  std::atomic<bool> end_{false};
  std::thread thread_;
};

/// What `--record` keeps beside a log so that it plays: the camera's keys, without those of a depth camera of
/// its own, since recorded depth is registered.
std::string recorded_profile(const LoadedConfig& loaded);

}  // namespace stillmap
