// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <memory>

#include "app/commands.h"
#include "eval/accuracy.h"
#include "runtime/output_file.h"
#include "runtime/report.h"

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
  const std::string text = accuracy_json(result.value());
  if (!o.report.empty()) return write_text(o.report, text);
  std::fputs(text.c_str(), stdout);
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
