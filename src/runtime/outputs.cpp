// SPDX-License-Identifier: Apache-2.0
#include "runtime/outputs.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <span>

#include "eval/consistency.h"
#include "runtime/saved_map.h"

namespace stillmap {

namespace {

constexpr const char* kTrajectoryHeader =
    "stamp tx ty tz qx qy qz qw: T_map_camera (camera x right, y down, z forward; metres; stamps of the "
    "source)";

std::span<const StampedPose> first_pass(const RunContext& context, const std::vector<Nanoseconds>& stamps) {
  const std::span<const StampedPose> all(context.track_log.causal);
  if (stamps.empty()) return all;
  const Nanoseconds last = *std::max_element(stamps.begin(), stamps.end());
  const auto beyond =
      std::find_if(all.begin(), all.end(), [&](const StampedPose& p) { return p.stamp_ns > last; });
  return all.first(static_cast<std::size_t>(beyond - all.begin()));
}

/// As everything is known at the end.
std::vector<StampedPose> final_poses(const RunContext& context) {
  const auto last = std::make_unique<Correction>();
  context.stages.track.tracker().describe_keyframes(*last);
  context.stages.final_trajectory.correct(*last);
  return context.stages.final_trajectory.poses();
}

Status save_map(RunContext& context) {
  const std::string& path = context.options.map;
  context.stages.map.finish_correction();
  Status written = write_map(path, context.config, context.stages, context.earlier_map);
  if (const std::string& kept = context.earlier_map.kept_as(); !kept.empty())
    spdlog::warn("map: the earlier {} was more than twice as large as this run's and is now {}", path, kept);
  return written;
}

void judge_accuracy(const RunContext& context, const std::vector<StampedPose>& groundtruth,
                    const std::vector<Nanoseconds>& stamps, ReportFacts& facts) {
  const std::span<const StampedPose> poses = first_pass(context, stamps);
  const Result<Accuracy> accuracy = evaluate(groundtruth, poses, stamps);
  if (!accuracy.ok()) {
    spdlog::warn("no accuracy: {}", accuracy.error().message);
    return;
  }
  facts.accuracy = accuracy.value();
  const std::span<const std::array<double, 36>> covariances(context.track_log.covariances);
  facts.share_in_ellipsoid =
      share_in_ellipsoid(groundtruth, poses, covariances.first(std::min(poses.size(), covariances.size())));
}

}  // namespace

Status check_outputs(const RunOptions& o, const Config& config) {
  for (const std::string* path :
       {&o.trajectory, &o.trajectory_final, &o.map, &o.report, &config.runtime.flight_recorder}) {
    if (path->empty()) continue;
    if (Status s = check_writable(*path); !s.ok()) return s;
  }
  // These are written while the stages run, and nobody may wait for a pipe's reader then.
  for (const std::string* path : {&config.runtime.flight_recorder, &o.map}) {
    if (path == &o.map && !is_map_file(o.map)) continue;
    std::error_code unknown;
    if (std::filesystem::exists(*path, unknown) && !std::filesystem::is_regular_file(*path, unknown))
      return Error{ExitCode::RunFailed, *path + ": cannot be written: it is no regular file; name one"};
  }
  if (!o.map.empty() && !o.map.ends_with(".ply") && !is_map_file(o.map)) {
    return Error{ExitCode::WrongConfig,
                 "--map " + o.map + ": expected a file name that ends in .stillmap or .ply"};
  }
  return {};
}

Status write_outputs(RunContext& context, ReportFacts& facts, const std::vector<StampedPose>& groundtruth,
                     const std::vector<Nanoseconds>& stamps) {
  const RunOptions& o = context.options;
  Status first;
  const auto keep_first = [&](const Status& s) {
    if (!s.ok() && first.ok()) first = s;
  };
  if (context.counters.posed() > 0) {
    if (!o.trajectory.empty())
      keep_first(write_trajectory(o.trajectory, context.track_log.causal, kTrajectoryHeader));
    if (!o.trajectory_final.empty())
      keep_first(write_trajectory(o.trajectory_final, final_poses(context), kTrajectoryHeader));
    if (!o.map.empty()) keep_first(save_map(context));
    if (!groundtruth.empty()) judge_accuracy(context, groundtruth, stamps, facts);
  }
  if (!o.report.empty()) keep_first(write_whole(o.report, make_report(context, facts)));
  return first;
}

void say_summary(const RunContext& context, const ReportFacts& facts) {
  const RunCounters& c = context.counters;
  const double wall_s = to_seconds(facts.run_end_ns - facts.run_start_ns);
  spdlog::info(
      "{} frames in {:.1f} s: {} before the first pose, {} tracked, {} weak, {} lost; {} keyframes, {} "
      "voxels",
      c.processed.load(), wall_s, c.initializing.load(), c.tracked.load(), c.weak.load(), c.lost.load(),
      c.keyframes.load(), context.stages.map.map().occupied_voxels());
  if (const std::uint64_t beyond = context.track_log.causal.usage("").refused; beyond > 0)
    spdlog::warn("{} later poses are in no trajectory; there is room for half an hour", beyond);
  if (!facts.accuracy) return;
  // A source without an end is nowhere covered.
  const double coverage = facts.accuracy->coverage;
  spdlog::info("ATE {:.4f} m (RMSE), {:.4f} m (max){}", facts.accuracy->ate_rmse_m, facts.accuracy->ate_max_m,
               std::isnan(coverage) ? std::string() : fmt::format(", coverage {:.3f}", coverage));
}

}  // namespace stillmap
