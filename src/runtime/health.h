// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>

#include "runtime/checkpoint.h"
#include "runtime/run_context.h"
#include "runtime/service_notifier.h"

namespace stillmap {

/// Turns events into log lines, and counts into what `/health` and `/metrics` answer. One thread, beside the
/// frame's way; it may use the heap.
class Health {
 public:
  explicit Health(RunContext& context)
      : context_(context),
        on_abort_(context.flight),
        checkpoint_(context.config, context.options.map, context.earlier_map, context.stages.map,
                    context.stages.track.copier()) {}
  void warn(const std::string& words);
  /// To the service manager: every stage has started.
  void ready() { notifier_.ready(); }
  /// To the service manager: the source has ended, or a stop was asked for.
  void stopping() { notifier_.stopping(); }
  /// Logs what happened since the last call and which stages are late; once a second, also what was dropped,
  /// and new texts for the stream. Keeps the service manager's watchdog calm unless a stage is stuck.
  void tick();
  /// The last words, when every stage has ended.
  void finish();

 private:
  void say(LogLevel level, const char* name, const std::string& text);
  void log_events();
  void log(const Event& event);
  void watch_stages(Nanoseconds now);
  std::string late_stages() const;
  void log_drops();
  void log_recorder();
  void log_playback();
  void publish();
  RunContext& context_;
  WriteOnAbort on_abort_;
  ServiceNotifier notifier_;
  std::array<bool, kStageCount> late_{};
  Checkpoint checkpoint_;
  Nanoseconds started_ns_ = monotonic_now();
  Nanoseconds published_ns_ = 0;
  std::uint64_t processed_before_ = 0, poses_before_ = 0, latency_before_us_ = 0;
  std::array<std::uint64_t, kDropReasonCount> drops_logged_{};
  std::uint64_t record_missing_logged_ = 0;
  bool playback_logged_ = false;
};

}  // namespace stillmap
