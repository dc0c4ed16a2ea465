// SPDX-License-Identifier: Apache-2.0
#include <map>
#include <memory>

#include "app/commands.h"
#include "runtime/run.h"

namespace stillmap {

void add_run_command(CLI::App& app, Action& action) {
  const auto o = std::make_shared<RunOptions>();
  CLI::App* run_app = app.add_subcommand("run", "Track, map and stream from a camera or a recorded log");
  run_app->add_option("--config", o->configs, "Configuration file; later ones override earlier ones")
      ->take_all();
  run_app->add_option("--set", o->overrides, "KEY=VALUE, overrides the files")->take_all();
  run_app->add_option(
      "--source", o->source,
      "tum:DIR, v4l2:COLOUR,DEPTH, openni2:[URI|FILE.oni] or libcamera:ID[,DEPTH]; without it, "
      "the first camera");
  run_app->add_option("--mode", o->mode, "live (cameras), realtime, fast or lockstep (logs)")
      ->transform(CLI::CheckedTransformer(std::map<std::string, RunMode>{{"live", RunMode::Live},
                                                                         {"realtime", RunMode::Realtime},
                                                                         {"fast", RunMode::Fast},
                                                                         {"lockstep", RunMode::Lockstep}}));
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
  run_app->callback([o, &action, delay, every, adjust] {
    const bool timed = delay->count() + every->count() + adjust->count() > 0;
    action = [o, timed]() -> Status {
      if (!timed || o->mode == RunMode::Lockstep) return run(*o);
      return Error{ExitCode::WrongConfig,
                   "--detector-delay, --detector-every and --adjust-delay are lockstep's; in every other "
                   "mode the work "
                   "takes the time it takes; add --mode lockstep"};
    };
  });
}

}  // namespace stillmap
