// SPDX-License-Identifier: Apache-2.0
#include "runtime/run.h"

#include <malloc.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <csignal>
#include <ctime>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "detect/model_file.h"
#include "runtime/heap_count.h"
#include "runtime/log_sink.h"
#include "runtime/memory_lock.h"
#include "runtime/memory_use.h"
#include "runtime/outputs.h"
#include "runtime/run_plan.h"
#include "runtime/saved_map.h"
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

/// Without a source the first camera is taken, without a profile of it its lens is guessed, and without its
/// own map to go on in, a run begins one.
Result<RunOptions> complete(RunOptions options) {
  if (options.source.empty()) {
    const std::vector<FoundSource> found = find_sources();
    const auto usable = std::ranges::find_if(found, [](const auto& f) { return !f.uri.empty(); });
    if (usable == found.end()) {
      return Error{
          ExitCode::RunFailed,
          "no camera found; plug one in (`stillmap doctor` looks for what is in its way), or play a log "
          "with --source tum:DIR"};
    }
    options.source = usable->uri;
    spdlog::info("source: {} ({})", usable->uri, usable->description);
  }
  if (lacks_profile(options)) {
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

Status check_mode(RunMode mode, bool is_log) {
  if (is_log == (mode != RunMode::Live)) return {};
  return Error{ExitCode::WrongConfig,
               is_log ? "--mode live is for cameras; a log plays in realtime, fast or lockstep"
                      : std::string("--mode ") + to_string(mode) + " is for logs; a camera runs live"};
}

/// What a run works on, all of it read and checked.
struct Inputs {
  RunOptions options;
  LoadedConfig loaded;
  std::vector<StampedPose> groundtruth;
  std::optional<MapFile> resumed;
  OpenedSource source;
  bool is_log = false;
  RunMode mode = RunMode::Realtime;
  ModelFile model;
  std::unique_ptr<Detector> detector;  // null: none

  const Config& config() const { return loaded.config; }
};

/// The network, or word why there is none.
Status open_detector(Inputs& in) {
  Result<ModelFile> model = find_model(in.config().detector);
  if (!model.ok()) return model.error();
  in.model = std::move(model.value());
  if (in.model.path.empty()) {
    spdlog::warn("{}", in.model.warning.empty()
                           ? "detector.model is \"none\": nothing that moves is recognised by what it is"
                           : in.model.warning);
    return {};
  }
  Result<std::unique_ptr<Detector>> opened = Detector::open(in.config(), in.model);
  if (!opened.ok()) return opened.error();
  in.detector = std::move(opened.value());
  in.model.bytes = {};
  if (!in.detector->class_warnings().empty()) spdlog::warn("{}", in.detector->class_warnings());
  return {};
}

/// The cheap before the dear, and all before anything is made.
Status open_inputs(const RunOptions& asked, Inputs& in) {
  Result<RunOptions> completed = complete(asked);
  if (!completed.ok()) return completed.error();
  const RunOptions& o = in.options = std::move(completed.value());
  Result<LoadedConfig> loaded = load_config_of_model(o.configs, o.overrides);
  if (!loaded.ok()) return loaded.error();
  in.loaded = std::move(loaded.value());
  if (!o.listen.empty()) in.loaded.config.stream.listen = o.listen;
  if (Status s = check_outputs(o, in.config()); !s.ok()) return s;
  if (!o.groundtruth.empty()) {
    Result<std::vector<StampedPose>> read = read_trajectory(o.groundtruth);
    if (!read.ok()) return read.error();
    in.groundtruth = std::move(read.value());
  }
  if (!o.resume.empty()) {
    Result<MapFile> read = read_resumed(o, in.config());
    if (!read.ok()) return read.error();
    in.resumed = std::move(read.value());
  }
  Result<OpenedSource> source = open_source(o.source, in.config(), o.loops);
  if (!source.ok()) return source.error();
  in.source = std::move(source.value());
  in.is_log = in.source.driver->describe().is_log;
  in.mode = mode_of(o, in.is_log);
  if (Status s = check_mode(in.mode, in.is_log); !s.ok()) return s;
  return open_detector(in);
}

Status open_stream(StreamServer& stream, const std::string& listen) {
  if (Status s = stream.open(); !s.ok()) return s;
  const std::string at = fmt::format("{}:{}", listen.substr(0, listen.rfind(':')), stream.port());
  spdlog::info("stream: open http://{} or point Foxglove at ws://{}", at, at);
  return {};
}

Recorder::Setup recorder_setup(const Inputs& in) {
  const Config& config = in.config();
  return {.folder = in.options.record,
          .width = config.camera.width,
          .height = config.camera.height,
          .exact_colour = config.record.colour == "png",
          .jpeg_quality = config.record.jpeg_quality,
          .camera_profile = recorded_profile(in.loaded)};
}

ReportFacts facts_of(const Inputs& in) {
  ReportFacts facts;
  facts.source = in.options.source;
  facts.config_sha256 = sha256_of(config_text(in.loaded));
  facts.model = in.model.path.empty() ? "none" : in.model.path;
  facts.model_sha256 = in.model.sha256;
  return facts;
}

/// From the first frame to the last, with what that costs.
void play(RunContext& context, ReportFacts& facts) {
  facts.rss_start_kb = resident_kb();
  facts.run_start_ns = monotonic_now();
  const double cpu_start_s = process_cpu_s();
  const std::uint64_t faults_before = major_faults();
  context.mode == RunMode::Lockstep ? run_lockstep(context) : run_threads(context);
  facts.run_end_ns = monotonic_now();
  facts.cpu_s = process_cpu_s() - cpu_start_s;
  facts.major_faults = major_faults() - faults_before;
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

Status run(const RunOptions& asked) {
  const Nanoseconds process_start_ns = monotonic_now();
  const HeapScope scope(HeapOwner::None);
  stop_requested.store(false);
  handle_signals();
  mallopt(M_ARENA_MAX, 1);  // the hot threads take nothing from the heap, and an arena never shrinks
  log_to_stderr();
  Inputs in;
  if (Status s = open_inputs(asked, in); !s.ok()) return s;
  const Config& config = in.config();
  RgbdDriver& driver = *in.source.driver;

  const Stages::Parts parts =
      parts_of(in.options, config, in.detector != nullptr, in.is_log, in.source.stamps.size());
  Arena planning;
  plan_memory(planning, config, parts);
  if (Status s = check_budget(planning, config); !s.ok()) return s;
  malloc_trim(0);  // what reading the network took for a moment goes back before the rest is taken
  Arena arena(planning.bytes_planned());
  const auto stages = std::make_unique<Stages>(arena, config, parts);
  if (parts.kept_blocks > 0) {
    if (Status s = stages->map.kept().open(in.options.map); !s.ok()) return s;
  }
  if (in.resumed) {
    if (Status s = resume(in.options.resume, *in.resumed, *stages); !s.ok()) return s;
    in.resumed.reset();
  }
  if (stages->stream) {
    if (Status s = open_stream(*stages->stream, config.stream.listen); !s.ok()) return s;
  }
  const auto context = std::make_unique<RunContext>(config, in.options, in.mode, driver, in.detector.get(),
                                                    *stages, stop_requested);
  if (!in.options.resume.empty()) context->counters.state = static_cast<int>(TrackState::Lost);
  context->source_news = in.source.news.get();
  std::optional<Recorder> recorder;
  std::optional<RecordLane> record;
  if (!in.options.record.empty()) {
    recorder.emplace(recorder_setup(in));
    if (Status s = recorder->open(); !s.ok()) return s;
    context->record = &record.emplace(*recorder, config.record.buffer_frames, context->counters);
  }
  if (Status s = driver.start(); !s.ok()) return s;
  if (config.memory.lock) {
    if (const std::string warning = lock_memory(); !warning.empty()) spdlog::warn("{}", warning);
  }

  ReportFacts facts = facts_of(in);
  facts.planned_bytes = arena.bytes_planned();
  facts.process_start_ns = process_start_ns;
  play(*context, facts);
  driver.stop();
  if (record) record->finish();
  if (stages->stream) stages->stream->stop();
  Status written = write_outputs(*context, facts, in.groundtruth, in.source.stamps);
  say_summary(*context, facts);
  return written.ok() ? run_outcome(*context) : written;
}

}  // namespace stillmap
