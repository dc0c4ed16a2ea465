// SPDX-License-Identifier: Apache-2.0
#include "runtime/run_plan.h"

#include <spdlog/fmt/fmt.h>

#include <memory>

#include "detect/model_file.h"
#include "runtime/record_lane.h"
#include "runtime/saved_map.h"
#include "runtime/source.h"

namespace stillmap {

namespace {

/// How many poses the outputs tell of; without any of them, none is kept.
std::size_t poses_to_keep(const RunOptions& o, const Config& config, std::size_t log_frames) {
  const bool written = !o.trajectory.empty() || !o.trajectory_final.empty();
  if (!written && o.groundtruth.empty()) return 0;
  constexpr double kOfACamera_s = 1800;
  if (log_frames == 0) return static_cast<std::size_t>(kOfACamera_s * config.mount.fps);
  return written ? log_frames * static_cast<std::size_t>(o.loops) : log_frames;
}

}  // namespace

RunMode mode_of(const RunOptions& o, bool is_log) {
  return o.mode.value_or(is_log ? RunMode::Realtime : RunMode::Live);
}

bool lacks_profile(const RunOptions& o) {
  return !o.source.starts_with("tum:") && !describes_camera(o.configs);
}

std::size_t kept_blocks(const RunOptions& o, const Config& config) {
  return is_map_file(o.map) ? static_cast<std::size_t>(config.map.kept_blocks) : 0;
}

Stages::Parts parts_of(const RunOptions& o, const Config& config, bool detector, bool is_log,
                       std::size_t log_frames) {
  return {.detector = detector,
          .stream = config.stream.listen != "off",
          .log = is_log,
          .lockstep_delay = mode_of(o, is_log) == RunMode::Lockstep ? o.detector.delay : 0,
          .recorder_frames = o.record.empty() ? 0 : RecordLane::frames_held(config.record.buffer_frames),
          .trajectory_poses = poses_to_keep(o, config, log_frames),
          .kept_blocks = kept_blocks(o, config),
          .final_trajectory = !o.trajectory_final.empty(),
          .groundtruth = !o.groundtruth.empty()};
}

Result<PlannedRun> plan_run(const RunOptions& options) {
  std::vector<std::string> overrides = options.overrides;
  PlannedRun planned;
  if (lacks_profile(options)) {
    const NominalProfile nominal = nominal_profile("");
    overrides.insert(overrides.begin(), nominal.overrides.begin(), nominal.overrides.end());
    planned.warning = "no camera profile: planned for 640 x 480 px, as a run without one would assume";
  }
  Result<LoadedConfig> loaded = load_config_of_model(options.configs, overrides);
  if (!loaded.ok()) return loaded.error();
  planned.config = loaded.value().config;
  if (!options.listen.empty()) planned.config.stream.listen = options.listen;
  const std::string& source = options.source;
  std::size_t log_frames = 0;
  if (source.starts_with("tum:")) {
    const Result<OpenedSource> log = open_source(source, planned.config, options.loops);
    if (!log.ok()) return log.error();
    log_frames = log.value().stamps.size();
  }
  const bool is_log = source.empty() || log_frames > 0 || source.ends_with(".oni");
  planned.parts =
      parts_of(options, planned.config, planned.config.detector.model != "none", is_log, log_frames);
  return planned;
}

void plan_memory(Arena& planning, const Config& config, const Stages::Parts& parts) {
  const auto stages = std::make_unique<Stages>(planning, config, parts);
}

Status check_budget(const Arena& planning, const Config& config) {
  const double mb = static_cast<double>(planning.bytes_planned()) / 1e6;
  if (mb <= config.memory.budget_mb) return {};
  return Error{ExitCode::WrongConfig,
               fmt::format("the memory plan needs {:.1f} MB, memory.budget_mb is {:.1f} MB; lower "
                           "map.capacity_voxels, track.keyframes or the camera's resolution, leave out "
                           "--trajectory, --trajectory-final or --record (`stillmap plan` with the run's "
                           "options shows the shares), or raise the budget",
                           mb, config.memory.budget_mb)};
}

}  // namespace stillmap
