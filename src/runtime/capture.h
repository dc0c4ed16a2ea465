// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/frame_pool.h"
#include "drivers/rgbd_driver.h"
#include "runtime/run_state.h"

namespace stillmap {

/// The source's frames, one after another, numbered and with grey made; what cannot be used is counted.
class Capture {
 public:
  Capture(RgbdDriver& driver, FramePool& frames, RunCounters& counters, CaptureLog& log)
      : driver_(driver), frames_(frames), counters_(counters), log_(log), is_log_(driver.describe().is_log) {}

  enum class Outcome { Frame, Nothing, End, Lost };
  /// `out` holds the next frame where the outcome is Frame. Nothing: this one was dropped, or none came in time.
  Outcome next(FrameHandle& out, Nanoseconds deadline_ns);

 private:
  RgbdDriver& driver_;
  FramePool& frames_;
  RunCounters& counters_;
  CaptureLog& log_;
  bool is_log_;
  std::uint64_t next_sequence_ = 0;
};

/// Luma after BT.601, as every grey conversion that descriptors were ever measured on.
void make_grey(ImageView<const Bgr> colour, ImageView<std::uint8_t> grey);

/// CPU time of the calling thread.
Nanoseconds thread_cpu_now();

}  // namespace stillmap
