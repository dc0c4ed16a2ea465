// SPDX-License-Identifier: Apache-2.0
#include "runtime/health.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <string>

#include "runtime/memory_use.h"

namespace stillmap {

void log_events(RunContext& context) {
  const auto log = [](const Event& e) {
    if (e.code == EventCode::FrameDropped) {
      spdlog::warn("{}: frame {} dropped: {}", to_string(e.stage), e.sequence, to_string(static_cast<DropReason>(e.a)));
    } else {
      spdlog::info("{}: {} at frame {} ({})", to_string(e.stage), to_string(e.code), e.sequence, e.a);
    }
  };
  for (EventRing& ring : context.events) {
    while (auto event = ring.try_pop()) log(*event);
  }
  if (context.stages.stream) {
    while (auto event = context.stages.stream->events().try_pop()) log(*event);
  }
}

void Health::tick() {
  log_events(context_);
  if (monotonic_now() - published_ns_ >= 1'000'000'000) publish();
}

void Health::publish() {
  const Nanoseconds now = monotonic_now();
  const RunCounters& c = context_.counters;
  const std::uint64_t processed = c.processed.load(std::memory_order_relaxed);
  const double fps = published_ns_ == 0 ? 0 : static_cast<double>(processed - processed_before_) / to_seconds(now - published_ns_);
  published_ns_ = now;
  processed_before_ = processed;
  if (!context_.stages.stream) return;

  std::uint64_t dropped = 0;
  std::string drops;
  for (int r = 0; r < kDropReasonCount; ++r) {
    const std::uint64_t count = c.dropped[static_cast<std::size_t>(r)].load(std::memory_order_relaxed);
    dropped += count;
    drops += fmt::format("stillmap_frames_dropped_total{{reason=\"{}\"}} {}\n", to_string(static_cast<DropReason>(r)), count);
  }
  const char* state = to_string(static_cast<TrackState>(c.state.load(std::memory_order_relaxed)));
  const std::uint64_t rss = resident_kb();
  const std::string json = fmt::format(
      "{{\"state\":\"{}\",\"fps\":{:.1f},\"uptime_s\":{:.1f},\"frames\":{{\"offered\":{},\"processed\":{},\"dropped\":{}}},"
      "\"tracking\":{{\"tracked\":{},\"weak\":{},\"lost\":{},\"keyframes\":{}}},\"detector_runs\":{},\"rss_kb\":{}}}",
      state, fps, to_seconds(now - started_ns_), c.offered.load(), processed, dropped, c.tracked.load(), c.weak.load(),
      c.lost.load(), c.keyframes.load(), c.detector_runs.load(), rss);
  const std::string metrics = fmt::format(
      "# TYPE stillmap_frames_offered_total counter\nstillmap_frames_offered_total {}\n"
      "# TYPE stillmap_frames_processed_total counter\nstillmap_frames_processed_total {}\n"
      "# TYPE stillmap_frames_dropped_total counter\n{}"
      "# TYPE stillmap_frames_lost_total counter\nstillmap_frames_lost_total {}\n"
      "# TYPE stillmap_detector_runs_total counter\nstillmap_detector_runs_total {}\n"
      "# TYPE stillmap_tracking_state gauge\nstillmap_tracking_state {}\n"
      "# TYPE stillmap_fps gauge\nstillmap_fps {:.2f}\n"
      "# TYPE stillmap_resident_bytes gauge\nstillmap_resident_bytes {}\n",
      c.offered.load(), processed, drops, c.lost.load(), c.detector_runs.load(), c.state.load(), fps, rss * 1024);
  if (!context_.stages.stream->publish_health(json, metrics)) spdlog::warn("health text is too long for the stream");
}

}  // namespace stillmap
