// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "runtime/run_context.h"

namespace stillmap {

/// Turns events into log lines, and counts into what `/health` and `/metrics` answer. One thread, beside the frame's
/// way; it may use the heap.
class Health {
 public:
  explicit Health(RunContext& context) : context_(context) {}
  /// Log what happened since the last call; once a second, new texts for the stream.
  void tick();

 private:
  void publish();
  RunContext& context_;
  Nanoseconds started_ns_ = monotonic_now();
  Nanoseconds published_ns_ = 0;
  std::uint64_t processed_before_ = 0;
};

/// Logs the events that have gathered; used at the end of a lockstep run too.
void log_events(RunContext& context);

}  // namespace stillmap
