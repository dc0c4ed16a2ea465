// SPDX-License-Identifier: Apache-2.0
#include "runtime/report.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "runtime/heap_count.h"
#include "runtime/memory_use.h"
#include "runtime/version.h"

namespace stillmap {

namespace {

using Json = nlohmann::ordered_json;

/// To so many decimals; a number that is none stays so, and JSON shows it as null.
double rounded(double value, int decimals) {
  const double unit = std::pow(10, decimals);
  return std::round(value * unit) / unit;
}

Json quantiles(const LatencyHistogram& h) {
  const auto ms = [](double v) { return rounded(v, 3); };
  return {{"p50", ms(h.quantile_ms(0.5))},
          {"p95", ms(h.quantile_ms(0.95))},
          {"p99", ms(h.quantile_ms(0.99))},
          {"max", ms(h.max_ms())}};
}

Json frames_part(const RunCounters& c) {
  Json dropped = Json::object();
  for (int r = 0; r < kDropReasonCount; ++r) {
    const std::uint64_t count = c.dropped[static_cast<std::size_t>(r)].load();
    if (count > 0) dropped[to_string(static_cast<DropReason>(r))] = count;
  }
  return {{"offered", c.offered.load()}, {"processed", c.processed.load()}, {"dropped", dropped}};
}

Json tracking_part(const RunCounters& c, const Tracker& tracker) {
  return {{"initializing", c.initializing.load()},
          {"tracked", c.tracked.load()},
          {"weak", c.weak.load()},
          {"lost", c.lost.load()},
          {"relocalized", c.relocalized.load()},
          {"segments", c.segments.load()},
          {"keyframes", c.keyframes.load()},
          {"corrections", c.corrections.load()},
          {"readout_s", rounded(tracker.readout_s(), 5)},
          {"features",
           {{"static", c.static_features.load()},
            {"dynamic", c.dynamic_features.load()},
            {"semi_static", c.semi_static_features.load()},
            {"unknown", c.unknown_features.load()}}}};
}

Json memory_part(const RunContext& context, const ReportFacts& facts) {
  const auto heap = heap_counts();
  const auto of = [&](HeapOwner owner) { return heap[static_cast<std::size_t>(owner)]; };
  Json pools = Json::object();
  const auto add = [&](const PoolUsage& u) {
    pools[u.name] = {{"capacity", u.capacity}, {"high_water", u.high_water}, {"refused", u.refused}};
  };
  add(context.stages.frames.usage());
  context.counters.for_each_pool(add);
  add(context.track_log.causal.usage("trajectory"));
  return {{"planned_bytes", facts.planned_bytes},
          {"rss_start_kb", facts.rss_start_kb},
          {"rss_end_kb", resident_kb()},
          {"rss_peak_kb", resident_peak_kb()},
          {"major_faults", facts.major_faults},
          {"heap_allocations_after_start",
           {{"capture", of(HeapOwner::Capture)},
            {"track", of(HeapOwner::Track)},
            {"map", of(HeapOwner::Map)},
            {"stream", of(HeapOwner::Stream)},
            {"detect", of(HeapOwner::Detect)},
            {"driver", of(HeapOwner::Driver)}}},
          {"pools", pools}};
}

Json record_part(const RunCounters& c) {
  const std::uint64_t frames = c.recorded.load();
  const double cpu_ms = to_ms(static_cast<Nanoseconds>(c.record_cpu_ns.load()));
  return {{"frames", frames},
          {"left_out", c.record_left_out.load()},
          {"failed", c.record_failed.load()},
          {"cpu_ms_per_frame", rounded(frames > 0 ? cpu_ms / static_cast<double>(frames) : 0, 3)}};
}

Json map_part(const RunContext& context) {
  const VoxelMap& map = context.stages.map.map();
  const FuseCounts& fused = context.stages.map.counts();
  const PoolUsage blocks = map.usage(), kept = context.stages.map.kept().usage();
  return {{"voxels", map.occupied_voxels()},
          {"blocks_used", map.blocks().blocks_used()},
          {"blocks_capacity", blocks.capacity},
          {"blocks_evicted", map.blocks_evicted()},
          {"blocks_kept", kept.high_water},
          {"blocks_lost", kept.capacity == 0 ? map.blocks_evicted() : kept.refused},
          {"voxel_m", map.voxel_m()},
          {"point_reduction", rounded(map.point_reduction(), 3)},
          {"frames_fused", map.fused_frames()},
          {"frames_fused_with_own_boxes", fused.own_boxes}};
}

/// What a camera's frames cost until they are in their slots.
Json capture_part(const CaptureLog& log) {
  const std::uint64_t frames = log.decode_time.count();
  const double cpu_ms = to_ms(log.decode_cpu_ns);
  Json part = {{"cpu_ms_per_frame", rounded(frames > 0 ? cpu_ms / static_cast<double>(frames) : 0, 3)}};
  if (log.stamp_to_slot.count() > 0) part["stamp_to_slot_ms"] = quantiles(log.stamp_to_slot);
  return part;
}

/// How often each stage was at work for longer than it may; without those that never were.
Json late_part(const RunCounters& c) {
  Json part = Json::object();
  for (std::size_t s = 0; s < c.late.size(); ++s) {
    if (const std::uint64_t times = c.late[s].load(); times > 0)
      part[to_string(static_cast<Stage>(s))] = times;
  }
  return part;
}

Json accuracy_part(const Accuracy& a) {
  Json part = {{"ate_rmse_m", a.ate_rmse_m},
               {"ate_max_m", a.ate_max_m},
               {"rpe_1s_rmse_m", a.rpe_1s_rmse_m},
               {"rpe_1s_rmse_deg", a.rpe_1s_rmse_deg},
               {"rpe_frame_rmse_m", a.rpe_frame_rmse_m},
               {"matched_poses", a.matched_poses},
               {"coverage", a.coverage}};
  if (a.coverage < 0.99) part["note"] = "the errors tell of the covered frames only";
  return part;
}

}  // namespace

std::string accuracy_json(const Accuracy& accuracy) {
  return accuracy_part(accuracy).dump() + "\n";
}

std::string make_report(const RunContext& context, const ReportFacts& facts) {
  const RunCounters& c = context.counters;
  const double wall_s = to_seconds(facts.run_end_ns - facts.run_start_ns);
  const BoxSupply& boxes = context.stages.track.box_supply();
  Json report;
  report["version"] = 1;
  report["mode"] = to_string(context.mode);
  report["source"] = facts.source;
  report["seed"] = context.config.runtime.seed;
  report["git_revision"] = kGitRevision;
  report["config_sha256"] = facts.config_sha256;
  report["model_sha256"] = facts.model_sha256;
  report["frames"] = frames_part(c);
  report["tracking"] = tracking_part(c, context.stages.track.tracker());
  report["latency_ms"] = {{"capture_to_pose", quantiles(context.track_log.capture_to_pose)},
                          {"decode", quantiles(context.capture_log.decode_time)},
                          {"track", quantiles(context.track_log.track_time)},
                          {"track_cpu", quantiles(context.track_log.track_cpu_time)},
                          {"adjust", quantiles(context.adjust_time)},
                          {"detect", quantiles(context.detect_time)},
                          {"fuse", quantiles(context.stages.map.fuse_time())},
                          {"fuse_cpu", quantiles(context.stages.map.fuse_cpu_time())}};
  if (!context.driver.describe().is_log) report["capture"] = capture_part(context.capture_log);
  if (context.mode == RunMode::Realtime)
    report["held_back_s"] = rounded(to_seconds(static_cast<Nanoseconds>(c.held_back_ns.load())), 3);
  report["throughput_fps"] = rounded(wall_s > 0 ? static_cast<double>(c.processed.load()) / wall_s : 0, 2);
  report["cpu_s"] = rounded(facts.cpu_s, 3);
  report["cpu_decode_s"] = rounded(to_seconds(context.capture_log.decode_cpu_ns), 3);
  report["wall_s"] = rounded(wall_s, 3);
  const Nanoseconds first_pose = context.track_log.first_pose_ns;
  report["start_to_first_pose_ms"] =
      first_pose == 0 ? Json() : Json(rounded(to_ms(first_pose - facts.process_start_ns), 1));
  report["detector"] = {{"model", facts.model},
                        {"runs", c.detector_runs.load()},
                        {"failures", c.detector_failures.load()},
                        {"frames_skipped", c.detector_skipped.load()},
                        {"latency_ms", quantiles(context.detect_time)},
                        {"frames_with_fresh_boxes", boxes.fresh},
                        {"frames_with_carried_boxes", boxes.carried},
                        {"frames_without_boxes", boxes.none}};
  if (context.record != nullptr) report["record"] = record_part(c);
  report["memory"] = memory_part(context, facts);
  report["shedding"] = {{"steps", c.quality_lowered.load()},
                        {"steps_back", c.quality_raised.load()},
                        {"frames_shed", c.frames_shed.load()}};
  report["late_stages"] = late_part(c);
  report["map"] = map_part(context);
  const StreamStats stream = context.stages.stream ? context.stages.stream->stats() : StreamStats{};
  report["stream"] = {{"clients_peak", stream.clients_peak},
                      {"bytes_sent", stream.bytes_sent},
                      {"messages_dropped", stream.messages_dropped}};
  if (facts.accuracy) {
    report["accuracy"] = accuracy_part(*facts.accuracy);
    report["accuracy"]["share_in_90_percent_ellipsoid_1s"] = facts.share_in_ellipsoid;
  }
  // A path that is no UTF-8 must not cost the report.
  return report.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace stillmap
