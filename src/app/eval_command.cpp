// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <filesystem>
#include <memory>

#include "app/commands.h"
#include "core/whole_file.h"
#include "drivers/tum_log/frame_list.h"
#include "eval/accuracy.h"
#include "runtime/report.h"
#include "runtime/source.h"

namespace stillmap {

namespace {

struct EvalOptions {
  std::string groundtruth, estimate, source, report;
};

/// The colour stamps of the frames that a run on `source` is offered; none where no source is given.
Result<std::vector<Nanoseconds>> frame_stamps(const std::string& source) {
  std::vector<Nanoseconds> stamps;
  if (source.empty()) return stamps;
  const Result<std::string> folder = log_folder(source);
  if (!folder.ok()) return folder.error();
  const auto frames = read_frame_list(folder.value());
  if (!frames.ok()) return frames.error();
  for (const ListedFrame& frame : frames.value()) stamps.push_back(frame.colour_ns);
  return stamps;
}

Status eval(const EvalOptions& o) {
  std::error_code unknown;
  if (std::filesystem::equivalent(o.report, o.groundtruth, unknown) ||
      std::filesystem::equivalent(o.report, o.estimate, unknown))
    return Error{ExitCode::WrongConfig,
                 "--report " + o.report + ": is one of the trajectories; give it another name"};
  const auto groundtruth = read_trajectory(o.groundtruth);
  if (!groundtruth.ok()) return groundtruth.error();
  const auto estimate = read_trajectory(o.estimate);
  if (!estimate.ok()) return estimate.error();
  const auto stamps = frame_stamps(o.source);
  if (!stamps.ok()) return stamps.error();
  const Result<Accuracy> result = evaluate(groundtruth.value(), estimate.value(), stamps.value());
  if (!result.ok()) return result.error();
  const std::string text = accuracy_json(result.value());
  if (!o.report.empty()) return write_whole(o.report, text);
  std::fputs(text.c_str(), stdout);
  return {};
}

}  // namespace

void add_eval_command(CLI::App& app, Action& action) {
  const auto o = std::make_shared<EvalOptions>();
  CLI::App* eval_app = app.add_subcommand("eval", "Compare a trajectory with ground truth");
  eval_app->add_option("--groundtruth", o->groundtruth, "TUM trajectory")->required();
  eval_app->add_option("--estimate", o->estimate, "TUM trajectory")->required();
  eval_app->add_option("--source", o->source,
                       "tum:DIR, the log that was played, for the coverage of its frames");
  eval_app->add_option("--report", o->report, "JSON file; without it, standard output");
  eval_app->callback([o, &action] { action = [o] { return eval(*o); }; });
}

}  // namespace stillmap
