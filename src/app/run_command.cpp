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
  run_app->add_option("--source", o->source,
                      "tum:DIR, v4l2:COLOUR,DEPTH or openni2:[URI|FILE.oni]; without it, the first camera");
  run_app->add_option("--mode", o->mode, "realtime or lockstep")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, RunMode>{{"lockstep", RunMode::Lockstep}, {"realtime", RunMode::Realtime}}));
  run_app
      ->add_option("--detector-delay", o->detector_delay,
                   "Frames that the detector's boxes come late (lockstep)")
      ->check(CLI::Range(0, 60));
  run_app
      ->add_option("--detector-every", o->detector_every, "The detector looks at every n-th frame (lockstep)")
      ->check(CLI::Range(1, 1000));
  run_app->add_option("--duration", o->duration_s, "Seconds of the source to use; 0: all")
      ->check(CLI::NonNegativeNumber);
  run_app->add_option("--trajectory", o->trajectory, "Each pose as first published, TUM format");
  run_app->add_option("--trajectory-final", o->trajectory_final, "The same frames after all corrections");
  run_app->add_option("--map", o->map, "The voxel map, .ply");
  run_app->add_option("--report", o->report, "Counts, times, memory and accuracy, JSON");
  run_app->add_option("--groundtruth", o->groundtruth, "TUM trajectory to compare with");
  run_app->add_option("--record", o->record,
                      "New folder for a log of what the source delivers; pictures show people as they are");
  run_app->add_option("--listen", o->listen, "ADDR:PORT of the stream, or off");
  run_app->callback([o, &action] { action = [o] { return run(*o); }; });
}

}  // namespace stillmap
