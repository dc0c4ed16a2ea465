// SPDX-License-Identifier: Apache-2.0
#include "runtime/health.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <numeric>
#include <string>

#include "runtime/event_words.h"
#include "runtime/memory_use.h"

namespace stillmap {

namespace {

std::string pool_lines(const RunContext& context) {
  const PoolUsage frames = context.stages.frames.usage();
  std::string high_water, capacity, refused;
  const auto add = [&](const PoolUsage& u) {
    high_water += fmt::format("stillmap_pool_high_water{{pool=\"{}\"}} {}\n", u.name, u.high_water);
    capacity += fmt::format("stillmap_pool_capacity{{pool=\"{}\"}} {}\n", u.name, u.capacity);
    refused += fmt::format("stillmap_pool_refused_total{{pool=\"{}\"}} {}\n", u.name, u.refused);
  };
  add(frames);
  context.counters.for_each_pool(add);
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

std::string late_lines(const RunCounters& c) {
  std::string lines;
  for (std::size_t s = 0; s < c.late.size(); ++s) {
    lines += fmt::format("stillmap_stage_late_total{{stage=\"{}\"}} {}\n", to_string(static_cast<Stage>(s)),
                         c.late[s].load());
  }
  return lines;
}

}  // namespace

void Health::say(LogLevel level, const char* name, const std::string& text) {
  if (level == LogLevel::Info) spdlog::info("{}: {}", name, text);
  if (level == LogLevel::Warning) spdlog::warn("{}: {}", name, text);
  if (context_.stages.stream) context_.stages.stream->publish_log(level, name, text);
}

void Health::log_events() {
  context_.flight.take_in();
  for (EventRing& ring : context_.events) {
    while (auto event = ring.try_pop()) log(*event);
  }
  if (context_.source_news != nullptr) {
    while (auto event = context_.source_news->events.try_pop()) log(*event);
  }
  if (context_.stages.stream) {
    while (auto event = context_.stages.stream->events().try_pop()) log(*event);
  }
}

void Health::log(const Event& e) {
  context_.flight.put(e);
  const char* refusal = "";
  if (e.code == EventCode::SourceRefused) {
    context_.source_news->refusal.refresh();
    refusal = context_.source_news->refusal.value().data();
  }
  const LogWords words = event_words(e, context_.config, refusal);
  say(words.level, to_string(e.stage), words.text);
  if (e.code == EventCode::TrackingLost && context_.flight.enabled() &&
      !context_.flight.write_unless_just_done(monotonic_now())) {
    warn(fmt::format("runtime.flight_recorder: cannot write {}", context_.flight.path()));
  }
}

void Health::warn(const std::string& words) {
  say(LogLevel::Warning, "stillmap", words);
}

void Health::watch_stages(Nanoseconds now) {
  for (int s = 0; s < kStageCount; ++s) {
    const auto stage = static_cast<Stage>(s);
    const auto i = static_cast<std::size_t>(s);
    const bool late = context_.watchdog.late(stage, now);
    if (late == late_[i]) continue;
    late_[i] = late;
    if (late) RunCounters::bump(context_.counters.late[i]);
    log({now, stage, late ? EventCode::StageLate : EventCode::StageInTime,
         context_.counters.processed.load(std::memory_order_relaxed),
         context_.watchdog.busy(stage, now) / 1'000'000});
  }
  if (!context_.watchdog.stuck(now)) notifier_.alive(now);
}

std::string Health::late_stages() const {
  std::string names;
  for (std::size_t i = 0; i < late_.size(); ++i) {
    if (late_[i])
      names += fmt::format("{}\"{}\"", names.empty() ? "" : ",", to_string(static_cast<Stage>(i)));
  }
  return names;
}

void Health::log_recorder() {
  const RunCounters& c = context_.counters;
  const std::uint64_t missing =
      c.record_failed.load(std::memory_order_relaxed) + c.record_left_out.load(std::memory_order_relaxed);
  if (missing == record_missing_logged_) return;
  warn(fmt::format(
      "{} frames are not in the recorded log ({} could not be written); is the disk full or slow?",
      missing - record_missing_logged_, c.record_failed.load(std::memory_order_relaxed)));
  record_missing_logged_ = missing;
}

void Health::log_playback() {
  constexpr std::uint64_t kHiccup_ns = 1'000'000'000;
  const std::uint64_t held_back_ns = context_.counters.held_back_ns.load(std::memory_order_relaxed);
  if (playback_logged_ || held_back_ns < kHiccup_ns) return;
  playback_logged_ = true;
  const double fps = context_.driver.describe().fps;
  const double gone_s = to_seconds(monotonic_now() - started_ns_);
  warn(fmt::format(
      "decoding is slower than the log, which plays at about {:.0f} of its {:.0f} frames/s; a faster disk or "
      "JPEG colour helps, and --mode lockstep does not mind",
      fps * std::max(0.0, 1 - to_seconds(static_cast<Nanoseconds>(held_back_ns)) / gone_s), fps));
}

void Health::log_drops() {
  for (std::size_t r = 0; r < drops_logged_.size(); ++r) {
    const std::uint64_t count = context_.counters.dropped[r].load(std::memory_order_relaxed);
    if (count == drops_logged_[r]) continue;
    say(LogLevel::Warning, to_string(Stage::Capture),
        fmt::format("{} frames dropped: {}", count - drops_logged_[r],
                    drop_words(static_cast<DropReason>(r), context_.config.camera)));
    drops_logged_[r] = count;
  }
}

void Health::tick() {
  log_events();
  watch_stages(monotonic_now());
  // An earlier map stays until there is one of this run.
  if (context_.counters.posed() > 0) checkpoint_.tick(monotonic_now());
  if (monotonic_now() - published_ns_ < 1'000'000'000) return;
  log_drops();
  log_recorder();
  log_playback();
  publish();
}

void Health::finish() {
  log_events();
  log_drops();
  log_recorder();
  log_playback();
}

void Health::publish() {
  const Nanoseconds now = monotonic_now();
  const RunCounters& c = context_.counters;
  const std::uint64_t processed = c.processed.load(std::memory_order_relaxed);
  const double fps = published_ns_ == 0 ? 0
                                        : static_cast<double>(processed - processed_before_) /
                                              to_seconds(now - published_ns_);
  const std::uint64_t poses = c.posed(), latency_us = c.latency_us.load();
  const double latency_ms = poses == poses_before_
                                ? 0
                                : 1e-3 * static_cast<double>(latency_us - latency_before_us_) /
                                      static_cast<double>(poses - poses_before_);
  poses_before_ = poses;
  latency_before_us_ = latency_us;
  published_ns_ = now;
  processed_before_ = processed;
  if (!context_.stages.stream) return;

  const std::uint64_t dropped = std::accumulate(drops_logged_.begin(), drops_logged_.end(), std::uint64_t{0});
  const char* state = to_string(static_cast<TrackState>(c.state.load(std::memory_order_relaxed)));
  const std::uint64_t rss = resident_kb();
  const std::string json = fmt::format(
      "{{\"state\":\"{}\",\"fps\":{:.1f},\"uptime_s\":{:.1f},\"frames\":{{\"offered\":{},\"processed\":{},"
      "\"dropped\":{}}},"
      "\"tracking\":{{\"tracked\":{},\"weak\":{},\"lost\":{},\"keyframes\":{}}},\"detector_runs\":{},"
      "\"quality\":\"{}\",\"late\":[{}],\"rss_kb\":{}}}",
      state, fps, to_seconds(now - started_ns_), c.offered.load(), processed, dropped, c.tracked.load(),
      c.weak.load(), c.lost.load(), c.keyframes.load(), c.detector_runs.load(), quality_now(context_).name,
      late_stages(), rss);
  const std::string metrics = fmt::format(
      "# TYPE stillmap_frames_offered_total counter\nstillmap_frames_offered_total {}\n"
      "# TYPE stillmap_frames_processed_total counter\nstillmap_frames_processed_total {}\n"
      "# TYPE stillmap_frames_dropped_total counter\n{}"
      "# TYPE stillmap_frames_lost_total counter\nstillmap_frames_lost_total {}\n"
      "# TYPE stillmap_detector_runs_total counter\nstillmap_detector_runs_total {}\n"
      "# TYPE stillmap_shedding_step gauge\nstillmap_shedding_step {}\n"
      "# TYPE stillmap_frames_shed_total counter\nstillmap_frames_shed_total {}\n"
      "# TYPE stillmap_stage_late_total counter\n{}"
      "# TYPE stillmap_tracking_state gauge\nstillmap_tracking_state {}\n"
      "# TYPE stillmap_fps gauge\nstillmap_fps {:.2f}\n"
      "# TYPE stillmap_resident_bytes gauge\nstillmap_resident_bytes {}\n{}",
      c.offered.load(), processed, drop_lines(c), c.lost.load(), c.detector_runs.load(),
      context_.quality.load(), c.frames_shed.load(), late_lines(c), c.state.load(), fps, rss * 1024,
      pool_lines(context_));
  const StreamHealth health{.state = state,
                            .uptime_s = to_seconds(now - started_ns_),
                            .fps = fps,
                            .latency_ms = latency_ms,
                            .frames_offered = c.offered.load(),
                            .frames_processed = processed,
                            .frames_dropped = dropped,
                            .frames_lost = c.lost.load(),
                            .keyframes = c.keyframes.load(),
                            .detector_runs = c.detector_runs.load(),
                            .rss_bytes = rss * 1024,
                            .map_blocks = c.blocks.high_water.load(),
                            .map_blocks_capacity = c.blocks.capacity.load()};
  if (!context_.stages.stream->publish_health(health, json, metrics))
    spdlog::warn("health text is too long for the stream");
}

}  // namespace stillmap
