// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "app/commands.h"
#include "runtime/run.h"

namespace stillmap {

namespace {

/// Two outputs in one file, or one in a file that is read, leave only what is written last. A map may go on
/// in its own file.
Status check_files_differ(const RunOptions& o) {
  std::vector<std::pair<std::string, std::string>> inputs{{"--groundtruth", o.groundtruth},
                                                          {"--resume", o.resume}};
  for (const std::string& file : o.configs) inputs.emplace_back("--config", file);
  for (const char* list : {"associations.txt", "rgb.txt", "depth.txt", "groundtruth.txt"})
    if (o.source.starts_with("tum:")) inputs.emplace_back("--source", o.source.substr(4) + "/" + list);
  const std::array<std::pair<const char*, const std::string*>, 4> outputs{
      {{"--trajectory", &o.trajectory},
       {"--trajectory-final", &o.trajectory_final},
       {"--map", &o.map},
       {"--report", &o.report}}};
  const auto same = [](const std::string& one, const std::string& other) {
    std::error_code unknown;
    return !one.empty() && !other.empty() &&
           std::filesystem::weakly_canonical(one, unknown) ==
               std::filesystem::weakly_canonical(other, unknown);
  };
  for (const auto& [option, path] : outputs) {
    for (const auto& [other, taken] : inputs) {
      if (same(*path, taken) && !(path == &o.map && other == "--resume"))
        return Error{ExitCode::WrongConfig,
                     other + " and " + option + " name the same file, " + *path + "; give each its own"};
    }
    inputs.emplace_back(option, *path);
  }
  return {};
}

void add_mode(CLI::App& run_app, const std::shared_ptr<RunOptions>& o) {
  std::vector<std::string> words;
  words.reserve(kRunModes.size());
  for (const RunMode mode : kRunModes) words.emplace_back(to_string(mode));
  const auto store = [o](const std::string& word) {
    o->mode = *std::ranges::find(kRunModes, word, [](RunMode m) { return std::string(to_string(m)); });
  };
  run_app
      .add_option_function<std::string>("--mode", store, "live (cameras), realtime, fast or lockstep (logs)")
      ->check(CLI::IsMember(words));
}

}  // namespace

void add_command_of_run(CLI::App& app, const char* name, const char* help,
                        Status (*command)(const RunOptions&), Action& action) {
  const auto o = std::make_shared<RunOptions>();
  CLI::App* run_app = app.add_subcommand(name, help);
  run_app->add_option("--config", o->configs, "Configuration file; later ones override earlier ones")
      ->take_all();
  run_app->add_option("--set", o->overrides, "KEY=VALUE, overrides the files")->take_all();
  run_app->add_option(
      "--source", o->source,
      "tum:DIR, v4l2:COLOUR,DEPTH, openni2:[URI|FILE.oni] or libcamera:ID[,DEPTH]; without it, "
      "the first camera");
  add_mode(*run_app, o);
  const CLI::Option* delay = run_app
                                 ->add_option("--detector-delay", o->detector.delay,
                                              "Frames that the detector's boxes come late (lockstep)")
                                 ->check(CLI::Range(0, 60))
                                 ->capture_default_str();
  const CLI::Option* every = run_app
                                 ->add_option("--detector-every", o->detector.every,
                                              "The detector looks at every n-th frame (lockstep)")
                                 ->check(CLI::Range(1, 1000))
                                 ->capture_default_str();
  const CLI::Option* adjust = run_app
                                  ->add_option("--adjust-delay", o->adjust_delay,
                                               "Frames that the local map's adjustment comes late (lockstep)")
                                  ->check(CLI::Range(0, 60))
                                  ->capture_default_str();
  run_app->add_option("--loop", o->loops, "Times that a log is played, forwards and backwards in turn")
      ->check(CLI::Range(1, 100'000));
  run_app->add_option("--duration", o->duration_s, "Seconds of the source to use; 0: all")
      ->check(CLI::NonNegativeNumber);
  run_app->add_option("--trajectory", o->trajectory, "Each pose as first published, TUM format");
  run_app->add_option("--trajectory-final", o->trajectory_final, "The same frames after all corrections");
  run_app->add_option("--map", o->map, "The voxel map, .stillmap (with checkpoints) or .ply");
  run_app->add_option("--resume", o->resume,
                      "Map file (.stillmap) of an earlier run to find the camera in and go on");
  run_app->add_option("--report", o->report, "Counts, times, memory and accuracy, JSON");
  run_app->add_option("--groundtruth", o->groundtruth, "TUM trajectory to compare with");
  run_app->add_option("--record", o->record,
                      "New folder for a log of what the source delivers; pictures show people as they are");
  run_app->add_option("--listen", o->listen, "ADDR:PORT of the stream, or off");
  run_app->callback([o, command, &action, delay, every, adjust] {
    const bool timed = delay->count() + every->count() + adjust->count() > 0;
    action = [o, command, timed]() -> Status {
      if (timed && o->mode != RunMode::Lockstep)
        return Error{
            ExitCode::WrongConfig,
            "--detector-delay, --detector-every and --adjust-delay are lockstep's; in every other mode "
            "the work takes the time it takes; add --mode lockstep"};
      if (std::isnan(o->duration_s))
        return Error{ExitCode::WrongConfig, "--duration nan: expected seconds; 0 for all"};
      if (Status s = check_files_differ(*o); !s.ok()) return s;
      return command(*o);
    };
  });
}

void add_run_command(CLI::App& app, Action& action) {
  add_command_of_run(app, "run", "Track, map and stream from a camera or a recorded log", run, action);
}

}  // namespace stillmap
