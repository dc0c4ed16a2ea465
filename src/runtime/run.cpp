// SPDX-License-Identifier: Apache-2.0
#include "runtime/run.h"

#include <malloc.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <ctime>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "detect/model_file.h"
#include "eval/accuracy.h"
#include "eval/consistency.h"
#include "map/map_file.h"
#include "map/ply.h"
#include "runtime/checkpoint.h"
#include "runtime/heap_count.h"
#include "runtime/log_sink.h"
#include "runtime/memory_lock.h"
#include "runtime/memory_use.h"
#include "runtime/report.h"
#include "runtime/run_context.h"
#include "runtime/source.h"

namespace stillmap {

namespace {

std::atomic<bool> stop_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler stores into it");

void on_signal(int) {
  stop_requested.store(true, std::memory_order_relaxed);
}

/// SIGINT and SIGTERM ask for an orderly end; a client that hangs up is no reason to die.
void handle_signals() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  action.sa_handler = SIG_IGN;
  sigaction(SIGPIPE, &action, nullptr);
}

double process_cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
}

/// Refuses before the run what could only fail after it.
Status check_outputs(const RunOptions& o, const Config& config) {
  for (const std::string* path :
       {&o.trajectory, &o.trajectory_final, &o.map, &o.report, &config.runtime.flight_recorder}) {
    if (path->empty()) continue;
    if (Status s = check_writable(*path); !s.ok()) return s;
  }
  if (!o.map.empty() && !o.map.ends_with(".ply") && !is_map_file(o.map)) {
    return Error{ExitCode::WrongConfig,
                 "--map " + o.map + ": expected a file name that ends in .stillmap or .ply"};
  }
  return {};
}

Status check_mode(RunMode mode, bool is_log) {
  if (is_log == (mode != RunMode::Live)) return {};
  return Error{ExitCode::WrongConfig,
               is_log ? "--mode live is for cameras; a log plays in realtime, fast or lockstep"
                      : std::string("--mode ") + to_string(mode) + " is for logs; a camera runs live"};
}

/// How many poses the outputs tell of; without any of them, none is kept.
std::size_t poses_to_keep(const RunOptions& o, const Config& config, std::size_t log_frames) {
  const bool written = !o.trajectory.empty() || !o.trajectory_final.empty();
  if (!written && o.groundtruth.empty()) return 0;
  constexpr double kOfACamera_s = 1800;
  if (log_frames == 0) return static_cast<std::size_t>(kOfACamera_s * config.mount.fps);
  return written ? log_frames * static_cast<std::size_t>(o.loops) : log_frames;
}

RunMode mode_of(const RunOptions& o, bool is_log) {
  return o.mode.value_or(is_log ? RunMode::Realtime : RunMode::Live);
}

Stages::Parts parts_of(const RunOptions& o, const Config& config, bool detector, bool is_log,
                       std::size_t log_frames) {
  return {.detector = detector,
          .stream = config.stream.listen != "off",
          .log = is_log,
          .lockstep_delay = mode_of(o, is_log) == RunMode::Lockstep ? o.detector.delay : 0,
          .recorder_frames = o.record.empty() ? 0 : RecordLane::frames_held(config.record.buffer_frames),
          .trajectory_poses = poses_to_keep(o, config, log_frames),
          .final_trajectory = !o.trajectory_final.empty(),
          .groundtruth = !o.groundtruth.empty()};
}

/// The poses of a log's first pass: ground truth knows no other.
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

Status write_map(RunContext& context, Nanoseconds timeout_ns) {
  MapFileWriter file(context.options.map, map_facts(context.config), timeout_ns, &context.earlier_map);
  append_blocks(context.stages.map.map().blocks(), file);
  const TrackStage& track = context.stages.track;
  std::vector<std::byte> bytes(KeyframeWriter::kLargestRecord);
  for (KeyframeWriter keyframes; !keyframes.done(track.tracker().local_map());) {
    const std::size_t size = keyframes.write(track.tracker().local_map(), track.T_map_odom(), bytes);
    file.append_keyframes(std::span(bytes).first(size));
  }
  return file.finish();
}

/// The map to go on in, where it fits the run.
Result<MapFile> read_resumed(const RunOptions& o, const Config& config) {
  Result<MapFile> map = read_map_file(o.resume);
  if (!map.ok()) return map;
  const auto wrong = [&](const std::string& what) {
    return Error{ExitCode::WrongConfig, "--resume " + o.resume + ": " + what};
  };
  const MapFacts &its = map.value().facts, own = map_facts(config);
  if (its.camera_hash != own.camera_hash)
    return wrong(
        "was mapped with another camera calibration; run with the camera file that it was mapped with");
  if (its.voxel_m != own.voxel_m)
    return wrong(fmt::format("has voxels of {:g} m, map.voxel_m is {:g} m; add --set map.voxel_m={:g}",
                             its.voxel_m, own.voxel_m, its.voxel_m));
  if (its.z_is_up != own.z_is_up)
    return wrong(its.z_is_up ? "was mapped with camera.T_base_camera set; set it as it was"
                             : "was mapped without camera.T_base_camera; leave it out");
  const std::size_t blocks = map.value().blocks->blocks_used();
  if (blocks > static_cast<std::size_t>(config.map.capacity_voxels / kBlockVoxels))
    return wrong(fmt::format("holds {} blocks; raise map.capacity_voxels to {} or more", blocks,
                             blocks * kBlockVoxels));
  return map;
}

/// Fills the stages with a map that `read_resumed` has let through.
Status resume(const RunOptions& o, const MapFile& map, Stages& stages) {
  if (Status s = stages.track.resume(map.keyframes); !s.ok())
    return Error{s.error().exit_code, "--resume " + o.resume + ": " + s.error().message};
  STILLMAP_CHECK(stages.map.resume(*map.blocks, stages.track.tracker().local_map().keyframes()));
  return {};
}

/// A run without a pose leaves earlier outputs as they are, but for the report, which counts why.
Status write_outputs(RunContext& context, ReportFacts& facts, const std::vector<StampedPose>& groundtruth,
                     const std::vector<Nanoseconds>& stamps) {
  const RunOptions& o = context.options;
  const std::string header =
      "stamp tx ty tz qx qy qz qw: T_map_camera (camera x right, y down, z forward; metres; stamps of the "
      "source)";
  Status first;
  const auto keep_first = [&](const Status& s) {
    if (!s.ok() && first.ok()) first = s;
  };
  const bool results = context.counters.posed() > 0;
  if (results && !o.trajectory.empty())
    keep_first(write_trajectory(o.trajectory, context.track_log.causal, header));
  if (results && !o.trajectory_final.empty())
    keep_first(write_trajectory(o.trajectory_final, final_poses(context), header));
  if (results && !o.map.empty()) {
    const auto timeout_ns = static_cast<Nanoseconds>(context.config.map.save_timeout_s * 1e9);
    context.stages.map.finish_correction();
    const VoxelMap& map = context.stages.map.map();
    keep_first(is_map_file(o.map)
                   ? write_map(context, timeout_ns)
                   : write_ply(map.blocks(), map.voxel_m(), o.map, timeout_ns, &context.earlier_map));
    if (const std::string& kept = context.earlier_map.kept_as(); !kept.empty())
      spdlog::warn("map: the earlier {} was more than twice as large as this run's and is now {}", o.map,
                   kept);
  }
  if (results && !groundtruth.empty()) {
    const std::span<const StampedPose> poses = first_pass(context, stamps);
    const Result<Accuracy> accuracy = evaluate(groundtruth, poses, stamps);
    if (accuracy.ok()) {
      facts.accuracy = accuracy.value();
      const std::span<const std::array<double, 36>> covariances(context.track_log.covariances);
      facts.share_in_ellipsoid = share_in_ellipsoid(
          groundtruth, poses, covariances.first(std::min(poses.size(), covariances.size())));
    }
    if (!accuracy.ok()) spdlog::warn("no accuracy: {}", accuracy.error().message);
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
  if (facts.accuracy) {
    // A source without an end is nowhere covered.
    const double coverage = facts.accuracy->coverage;
    spdlog::info("ATE {:.4f} m (RMSE), {:.4f} m (max){}", facts.accuracy->ate_rmse_m,
                 facts.accuracy->ate_max_m,
                 std::isnan(coverage) ? std::string() : fmt::format(", coverage {:.3f}", coverage));
  }
}

/// Why a run has nothing to show, and the mend.
std::string why_no_pose(const RunContext& context) {
  const std::uint64_t processed = context.counters.processed.load();
  const std::string none = fmt::format("none of {} frames could be tracked: ", processed);
  if (processed == 0) return "no frame could be used; the report (--report FILE) counts why";
  if (!context.options.resume.empty())
    return none + "the map of --resume was not recognised; begin where it was mapped, or leave --resume out";
  return none +
         "they show too few points with depth; is camera.depth_units_per_m right, the lens free and the "
         "light on?";
}

}  // namespace

void plan_memory(Arena& planning, const Config& config, const Stages::Parts& parts) {
  const auto stages = std::make_unique<Stages>(planning, config, parts);
}

Result<PlannedRun> plan_run(const RunOptions& options) {
  const Result<LoadedConfig> loaded = load_config_of_model(options.configs, options.overrides);
  if (!loaded.ok()) return loaded.error();
  PlannedRun planned{loaded.value().config, {}};
  Config& config = planned.config;
  if (!options.listen.empty()) config.stream.listen = options.listen;
  const std::string& source = options.source;
  std::size_t log_frames = 0;
  if (source.starts_with("tum:")) {
    const Result<OpenedSource> log = open_source(source, config, options.loops);
    if (!log.ok()) return log.error();
    log_frames = log.value().stamps.size();
  }
  const bool is_log = source.empty() || log_frames > 0 || source.ends_with(".oni");
  planned.parts = parts_of(options, config, config.detector.model != "none", is_log, log_frames);
  return planned;
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

Status run_outcome(const RunContext& context) {
  const std::string& source = context.options.source;
  if (context.source_lost && context.driver.describe().is_log)
    return Error{ExitCode::UnreadableInput, source + ": is damaged and plays so far only; record it anew"};
  if (context.source_lost)
    return Error{ExitCode::RunFailed, source + ": the source is gone; check its cable and power"};
  if (context.counters.posed() == 0 && !context.stop.load())
    return Error{ExitCode::UnreadableInput, source + ": " + why_no_pose(context)};
  if (const std::uint64_t failed = context.counters.record_failed.load(); failed > 0) {
    return Error{
        ExitCode::RunFailed,
        fmt::format("--record {}: {} frames could not be written, the others play; is the disk full?",
                    context.options.record, failed)};
  }
  return {};
}

namespace {

/// Without a source the first camera is taken, without a profile of it its lens is guessed, and without its
/// own map to go on in, a run begins one.
Result<RunOptions> complete(RunOptions options) {
  const bool camera = !options.source.starts_with("tum:");
  if (options.source.empty()) {
    const std::vector<FoundSource> found = find_sources();
    const auto usable =
        std::find_if(found.begin(), found.end(), [](const auto& f) { return !f.uri.empty(); });
    if (usable == found.end()) {
      return Error{
          ExitCode::RunFailed,
          "no camera found; plug one in (`stillmap doctor` looks for what is in its way), or play a log "
          "with --source tum:DIR"};
    }
    options.source = usable->uri;
    spdlog::info("source: {} ({})", usable->uri, usable->description);
  }
  if (camera && !describes_camera(options.configs)) {
    const NominalProfile nominal = nominal_profile(options.source);
    options.overrides.insert(options.overrides.begin(), nominal.overrides.begin(), nominal.overrides.end());
    spdlog::warn("{}", nominal.warning);
  }
  // A service goes on in its own map; the first time there is none.
  std::error_code unused;
  if (!options.resume.empty() && options.resume == options.map &&
      std::filesystem::status(options.resume, unused).type() == std::filesystem::file_type::not_found) {
    spdlog::info("resume: {} is not there yet; a new map begins", options.resume);
    options.resume.clear();
  }
  return options;
}

}  // namespace

Status run(const RunOptions& asked) {
  const Nanoseconds process_start_ns = monotonic_now();
  const HeapScope scope(HeapOwner::None);
  stop_requested.store(false);
  handle_signals();
  mallopt(M_ARENA_MAX, 1);  // the hot threads take nothing from the heap, and an arena never shrinks
  log_to_stderr();
  const Result<RunOptions> completed = complete(asked);
  if (!completed.ok()) return completed.error();
  const RunOptions& options = completed.value();
  const Result<LoadedConfig> loaded = load_config_of_model(options.configs, options.overrides);
  if (!loaded.ok()) return loaded.error();
  Config config = loaded.value().config;
  if (!options.listen.empty()) config.stream.listen = options.listen;
  if (Status s = check_outputs(options, config); !s.ok()) return s;

  std::vector<StampedPose> groundtruth;
  if (!options.groundtruth.empty()) {
    Result<std::vector<StampedPose>> read = read_trajectory(options.groundtruth);
    if (!read.ok()) return read.error();
    groundtruth = std::move(read.value());
  }
  std::optional<MapFile> resumed;
  if (!options.resume.empty()) {
    Result<MapFile> read = read_resumed(options, config);
    if (!read.ok()) return read.error();
    resumed = std::move(read.value());
  }
  Result<OpenedSource> source = open_source(options.source, config, options.loops);
  if (!source.ok()) return source.error();
  const bool is_log = source.value().driver->describe().is_log;
  const RunMode mode = mode_of(options, is_log);
  if (Status s = check_mode(mode, is_log); !s.ok()) return s;
  Result<ModelFile> model = find_model(config.detector);
  if (!model.ok()) return model.error();
  std::unique_ptr<Detector> detector;
  if (!model.value().path.empty()) {
    Result<std::unique_ptr<Detector>> opened = Detector::open(config, model.value());
    if (!opened.ok()) return opened.error();
    detector = std::move(opened.value());
    model.value().bytes = {};
    if (!detector->class_warnings().empty()) spdlog::warn("{}", detector->class_warnings());
  } else if (!model.value().warning.empty()) {
    spdlog::warn("{}", model.value().warning);
  } else {
    spdlog::warn("detector.model is \"none\": nothing that moves is recognised by what it is");
  }

  const Stages::Parts parts =
      parts_of(options, config, detector != nullptr, is_log, source.value().stamps.size());
  Arena planning;
  plan_memory(planning, config, parts);
  if (Status s = check_budget(planning, config); !s.ok()) return s;
  malloc_trim(0);  // what reading the network took for a moment goes back before the rest is taken
  Arena arena(planning.bytes_planned());
  const auto stages = std::make_unique<Stages>(arena, config, parts);
  if (resumed) {
    if (Status s = resume(options, *resumed, *stages); !s.ok()) return s;
    resumed.reset();
  }
  if (stages->stream) {
    if (Status s = stages->stream->open(); !s.ok()) return s;
    const std::string& listen = config.stream.listen;
    const std::string at = fmt::format("{}:{}", listen.substr(0, listen.rfind(':')), stages->stream->port());
    spdlog::info("stream: open http://{} or point Foxglove at ws://{}", at, at);
  }

  const auto context = std::make_unique<RunContext>(config, options, mode, *source.value().driver,
                                                    detector.get(), *stages, stop_requested);
  if (!options.resume.empty()) context->counters.state = static_cast<int>(TrackState::Lost);
  context->source_news = source.value().news.get();
  std::unique_ptr<Recorder> recorder;
  std::unique_ptr<RecordLane> record;
  if (!options.record.empty()) {
    recorder =
        std::make_unique<Recorder>(Recorder::Setup{.folder = options.record,
                                                   .width = config.camera.width,
                                                   .height = config.camera.height,
                                                   .exact_colour = config.record.colour == "png",
                                                   .jpeg_quality = config.record.jpeg_quality,
                                                   .camera_profile = recorded_profile(loaded.value())});
    if (Status s = recorder->open(); !s.ok()) return s;
    record = std::make_unique<RecordLane>(*recorder, config.record.buffer_frames, context->counters);
    context->record = record.get();
  }
  if (Status s = source.value().driver->start(); !s.ok()) return s;
  if (config.memory.lock) {
    if (const std::string warning = lock_memory(); !warning.empty()) spdlog::warn("{}", warning);
  }

  ReportFacts facts;
  facts.source = options.source;
  facts.config_sha256 = sha256_of(config_text(loaded.value()));
  facts.model = model.value().path.empty() ? "none" : model.value().path;
  facts.model_sha256 = model.value().sha256;
  facts.planned_bytes = arena.bytes_planned();
  facts.rss_start_kb = resident_kb();
  facts.process_start_ns = process_start_ns;
  facts.run_start_ns = monotonic_now();
  const double cpu_start_s = process_cpu_s();
  const std::uint64_t faults_before = major_faults();
  if (mode == RunMode::Lockstep) {
    run_lockstep(*context);
  } else {
    run_threads(*context);
  }
  facts.run_end_ns = monotonic_now();
  facts.cpu_s = process_cpu_s() - cpu_start_s;
  facts.major_faults = major_faults() - faults_before;
  source.value().driver->stop();
  if (record != nullptr) record->finish();
  if (stages->stream) stages->stream->stop();

  Status written = write_outputs(*context, facts, groundtruth, source.value().stamps);
  say_summary(*context, facts);
  if (!written.ok()) return written;
  return run_outcome(*context);
}

}  // namespace stillmap
