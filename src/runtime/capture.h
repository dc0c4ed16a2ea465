// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <optional>

#include "core/frame_pool.h"
#include "drivers/rgbd_driver.h"
#include "runtime/depth_check.h"
#include "runtime/run_state.h"

namespace stillmap {

/// The source's frames, one after another, numbered; what cannot be used is counted: every
/// frame that the source offers is handed out or dropped with its reason. Depth that cannot be right is told
/// as an event, once for each kind of fault.
///
/// Stamps rise. A camera's frames that come from before the newest are dropped; where a second of them has
/// risen among themselves, the camera's clock has been set back for good, and its stamps are moved to go on
/// from there.
///
/// The source fills a spare frame of the pool. A camera's is handed out only when the next spare is there: it
/// is read, and its frames are dropped one by one, also while the stages hold every other frame. A log waits.
class Capture {
 public:
  /// Frames later than `duration_s` after the first are not offered any more; 0: all are.
  Capture(RgbdDriver& driver, const CameraModel& camera, FramePool& frames, RunCounters& counters,
          CaptureLog& log, EventRing& events, double duration_s)
      : driver_(driver),
        frames_(frames),
        counters_(counters),
        log_(log),
        events_(events),
        is_log_(driver.describe().is_log),
        stamps_are_monotonic_(driver.describe().monotonic_stamps),
        duration_s_(duration_s),
        depth_check_(camera),
        spare_(frames.acquire()) {
    STILLMAP_CHECK(spare_);
  }

  enum class Outcome { Frame, Nothing, End, Lost };
  /// A log's next frame waits for a place in the pool.
  bool waits_for_room() const { return !spare_; }
  /// `out` holds the next frame, due when it was had, where the outcome is Frame. Nothing: this one was
  /// dropped, none came in time, or a log's next frame waits for a place in the pool.
  Outcome next(FrameHandle& out, Nanoseconds deadline_ns);

 private:
  Outcome fill_spare(Nanoseconds deadline_ns);
  void drop(DropReason reason);
  bool mend_clock(FrameSlot& slot);
  void tell_jump(const FrameSlot& slot);
  void check_depth(const FrameSlot& slot);
  void tell(EventCode code, std::int64_t a);

  RgbdDriver& driver_;
  FramePool& frames_;
  RunCounters& counters_;
  CaptureLog& log_;
  EventRing& events_;
  bool is_log_, stamps_are_monotonic_;
  double duration_s_;
  DepthCheck depth_check_;
  DepthFault depth_fault_told_ = DepthFault::None;
  FrameHandle spare_;
  std::uint64_t next_sequence_ = 0;
  std::optional<Nanoseconds> first_stamp_ns_;
  Nanoseconds newest_stamp_ns_ = std::numeric_limits<Nanoseconds>::min();
  Nanoseconds newest_arrival_ns_ = 0;  // monotonic
  static constexpr int kFramesToBelieve = 30;
  Nanoseconds clock_offset_ns_ = 0;  // added to the source's stamps
  Nanoseconds last_early_ns_ = 0;    // of the last frame from before the newest, and how many such have risen
  int early_ = 0;
};

/// CPU time of the calling thread.
Nanoseconds thread_cpu_now();

}  // namespace stillmap
