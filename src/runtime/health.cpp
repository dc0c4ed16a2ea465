// SPDX-License-Identifier: Apache-2.0
#include "runtime/health.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <numeric>
#include <string>

#include "runtime/memory_use.h"

namespace stillmap {

namespace {

std::string pool_lines(const RunContext& context) {
  const PoolUsage frames = context.stages.frames.usage();
  std::string high_water, capacity, refused;
  const auto add = [&](const char* name, std::uint64_t high, std::uint64_t room, std::uint64_t refusals) {
    high_water += fmt::format("stillmap_pool_high_water{{pool=\"{}\"}} {}\n", name, high);
    capacity += fmt::format("stillmap_pool_capacity{{pool=\"{}\"}} {}\n", name, room);
    refused += fmt::format("stillmap_pool_refused_total{{pool=\"{}\"}} {}\n", name, refusals);
  };
  add(frames.name, frames.high_water, frames.capacity, frames.refused);
  const RunCounters& c = context.counters;
  for (const PoolMark* mark : {&c.points, &c.keyframe_pool, &c.blocks}) {
    const char* name = mark->name.load(std::memory_order_acquire);
    if (name != nullptr) add(name, mark->high_water.load(), mark->capacity.load(), mark->refused.load());
  }
  return "# TYPE stillmap_pool_high_water gauge\n" + high_water + "# TYPE stillmap_pool_capacity gauge\n" +
         capacity + "# TYPE stillmap_pool_refused_total counter\n" + refused;
}

std::string drop_lines(const RunCounters& c) {
  std::string lines;
  for (int r = 0; r < kDropReasonCount; ++r) {
    lines +=
        fmt::format("stillmap_frames_dropped_total{{reason=\"{}\"}} {}\n",
                    to_string(static_cast<DropReason>(r)), c.dropped[static_cast<std::size_t>(r)].load());
  }
  return lines;
}

}  // namespace

void Health::log_events() {
  const auto log = [](const Event& e) {
    spdlog::info("{}: {} at frame {} ({})", to_string(e.stage), to_string(e.code), e.sequence, e.a);
  };
  for (EventRing& ring : context_.events) {
    while (auto event = ring.try_pop()) log(*event);
  }
  if (context_.source_events != nullptr) {
    while (auto event = context_.source_events->try_pop()) log(*event);
  }
  if (context_.stages.stream) {
    while (auto event = context_.stages.stream->events().try_pop()) log(*event);
  }
}

void Health::log_depth() {
  const DepthCheck::Verdict v = context_.counters.depth_verdict.load(std::memory_order_relaxed);
  if (v.fault == depth_fault_logged_) return;
  depth_fault_logged_ = v.fault;
  switch (v.fault) {
    case DepthFault::None:
      break;
    case DepthFault::Empty:
      spdlog::warn("depth: {} % of the pixels have no reading; is the depth camera covered, or too near?",
                   v.percent);
      break;
    case DepthFault::Scale:
      spdlog::warn(
          "depth: {} % of the readings lie outside camera.depth_min_m to camera.depth_max_m; is "
          "camera.depth_units_per_m = {} right?",
          v.percent, context_.config.camera.depth_units_per_m);
      break;
    case DepthFault::Unregistered:
      spdlog::warn(
          "depth: its edges lie {} px beside those of colour; is it registered? A depth camera that does "
          "not do so by itself needs camera.depth in the profile",
          v.shift_px);
      break;
  }
}

void Health::log_recorder() {
  const RunCounters& c = context_.counters;
  const std::uint64_t missing =
      c.record_failed.load(std::memory_order_relaxed) + c.record_left_out.load(std::memory_order_relaxed);
  if (missing == record_missing_logged_) return;
  spdlog::warn("{} frames are not in the recorded log ({} could not be written); is the disk full or slow?",
               missing - record_missing_logged_, c.record_failed.load(std::memory_order_relaxed));
  record_missing_logged_ = missing;
}

void Health::log_drops() {
  for (std::size_t r = 0; r < drops_logged_.size(); ++r) {
    const std::uint64_t count = context_.counters.dropped[r].load(std::memory_order_relaxed);
    if (count == drops_logged_[r]) continue;
    spdlog::warn("{} frames dropped: {}", count - drops_logged_[r], to_string(static_cast<DropReason>(r)));
    drops_logged_[r] = count;
  }
}

void Health::tick() {
  log_events();
  if (monotonic_now() - published_ns_ < 1'000'000'000) return;
  log_drops();
  log_depth();
  log_recorder();
  publish();
}

void Health::finish() {
  log_events();
  log_drops();
  log_depth();
  log_recorder();
}

void Health::publish() {
  const Nanoseconds now = monotonic_now();
  const RunCounters& c = context_.counters;
  const std::uint64_t processed = c.processed.load(std::memory_order_relaxed);
  const double fps = published_ns_ == 0 ? 0
                                        : static_cast<double>(processed - processed_before_) /
                                              to_seconds(now - published_ns_);
  published_ns_ = now;
  processed_before_ = processed;
  if (!context_.stages.stream) return;

  const std::uint64_t dropped = std::accumulate(drops_logged_.begin(), drops_logged_.end(), std::uint64_t{0});
  const char* state = to_string(static_cast<TrackState>(c.state.load(std::memory_order_relaxed)));
  const std::uint64_t rss = resident_kb();
  const std::string json = fmt::format(
      "{{\"state\":\"{}\",\"fps\":{:.1f},\"uptime_s\":{:.1f},\"frames\":{{\"offered\":{},\"processed\":{},"
      "\"dropped\":{}}},"
      "\"tracking\":{{\"tracked\":{},\"weak\":{},\"lost\":{},\"keyframes\":{}}},\"detector_runs\":{},\"rss_"
      "kb\":{}}}",
      state, fps, to_seconds(now - started_ns_), c.offered.load(), processed, dropped, c.tracked.load(),
      c.weak.load(), c.lost.load(), c.keyframes.load(), c.detector_runs.load(), rss);
  const std::string metrics = fmt::format(
      "# TYPE stillmap_frames_offered_total counter\nstillmap_frames_offered_total {}\n"
      "# TYPE stillmap_frames_processed_total counter\nstillmap_frames_processed_total {}\n"
      "# TYPE stillmap_frames_dropped_total counter\n{}"
      "# TYPE stillmap_frames_lost_total counter\nstillmap_frames_lost_total {}\n"
      "# TYPE stillmap_detector_runs_total counter\nstillmap_detector_runs_total {}\n"
      "# TYPE stillmap_tracking_state gauge\nstillmap_tracking_state {}\n"
      "# TYPE stillmap_fps gauge\nstillmap_fps {:.2f}\n"
      "# TYPE stillmap_resident_bytes gauge\nstillmap_resident_bytes {}\n{}",
      c.offered.load(), processed, drop_lines(c), c.lost.load(), c.detector_runs.load(), c.state.load(), fps,
      rss * 1024, pool_lines(context_));
  if (!context_.stages.stream->publish_health(json, metrics))
    spdlog::warn("health text is too long for the stream");
}

}  // namespace stillmap
