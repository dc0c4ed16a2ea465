// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <fstream>
#include <memory>

#include "app/commands.h"
#include "eval/accuracy.h"

namespace stillmap {

namespace {

struct EvalOptions {
  std::string groundtruth, estimate, report;
};

Status eval(const EvalOptions& o) {
  const auto groundtruth = read_trajectory(o.groundtruth);
  if (!groundtruth.ok()) return groundtruth.error();
  const auto estimate = read_trajectory(o.estimate);
  if (!estimate.ok()) return estimate.error();
  const Result<Accuracy> result = evaluate(groundtruth.value(), estimate.value(), {});
  if (!result.ok()) return result.error();
  const Accuracy& a = result.value();
  char text[512];
  std::snprintf(text, sizeof text,
                "{\"ate_rmse_m\": %.6f, \"ate_max_m\": %.6f, \"rpe_1s_rmse_m\": %.6f, \"rpe_1s_rmse_deg\": %.6f, "
                "\"rpe_frame_rmse_m\": %.6f, \"matched_poses\": %zu, \"coverage\": %.4f}\n",
                a.ate_rmse_m, a.ate_max_m, a.rpe_1s_rmse_m, a.rpe_1s_rmse_deg, a.rpe_frame_rmse_m, a.matched_poses, a.coverage);
  if (o.report.empty()) {
    std::fputs(text, stdout);
    return {};
  }
  std::ofstream file(o.report);
  file << text;
  file.flush();
  if (!file) return Error{ExitCode::RunFailed, o.report + ": cannot be written; check the folder and its permissions"};
  return {};
}

}  // namespace

void add_eval_command(CLI::App& app, Action& action) {
  const auto o = std::make_shared<EvalOptions>();
  CLI::App* eval_app = app.add_subcommand("eval", "Compare a trajectory with ground truth");
  eval_app->add_option("--groundtruth", o->groundtruth, "TUM trajectory")->required();
  eval_app->add_option("--estimate", o->estimate, "TUM trajectory")->required();
  eval_app->add_option("--report", o->report, "JSON file; without it, standard output");
  eval_app->callback([o, &action] { action = [o] { return eval(*o); }; });
}

}  // namespace stillmap
