// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "runtime/run_context.h"

namespace stillmap {

/// Turns events into log lines, and counts into what `/health` and `/metrics` answer. One thread, beside the
/// frame's way; it may use the heap.
class Health {
 public:
  explicit Health(RunContext& context) : context_(context) {}
  /// Logs what happened since the last call; once a second, also what was dropped, and new texts for the
  /// stream.
  void tick();
  /// The last words, when every stage has ended.
  void finish();

 private:
  void log_events();
  void log_drops();
  void log_recorder();
  void log_depth();
  void publish();
  RunContext& context_;
  Nanoseconds started_ns_ = monotonic_now();
  Nanoseconds published_ns_ = 0;
  std::uint64_t processed_before_ = 0;
  std::array<std::uint64_t, kDropReasonCount> drops_logged_{};
  std::uint64_t record_missing_logged_ = 0;
  DepthFault depth_fault_logged_ = DepthFault::None;
};

}  // namespace stillmap
