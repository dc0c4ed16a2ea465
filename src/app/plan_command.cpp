// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <utility>

#include "app/commands.h"
#include "core/stderr_text.h"
#include "runtime/run_plan.h"

namespace stillmap {

namespace {

void print_plan(const Arena& planning, const FrameBudget& frames, double budget_mb) {
  const double total = static_cast<double>(planning.bytes_planned());
  std::printf("%-28s %12s %12s %10s %7s\n", "pool", "count", "bytes each", "MB", "share");
  for (const PlanLine& line : planning.lines()) {
    const double bytes = static_cast<double>(line.bytes());
    std::printf("%-28s %12llu %12llu %10.3f %6.1f%%\n", line.name,
                static_cast<unsigned long long>(line.count), static_cast<unsigned long long>(line.item_bytes),
                bytes / 1e6, 100 * bytes / total);
  }
  std::printf("%-28s %12s %12s %10.3f (budget %.1f MB)\n", "total", "", "", total / 1e6, budget_mb);
  std::printf("frames: %zu =", frames.sum());
  const char* plus = "";
  for (const FrameBudget::Line& line : frames.lines) {
    if (line.frames > 0) std::printf("%s %s %zu", std::exchange(plus, " +"), line.who, line.frames);
  }
  std::printf("\n");
}

Status plan(const RunOptions& options) {
  const Result<PlannedRun> planned = plan_run(options);
  if (!planned.ok()) return planned.error();
  const auto& [config, parts, warning] = planned.value();
  if (!warning.empty()) write_stderr(warning + "\n");
  Arena planning;
  plan_memory(planning, config, parts);
  print_plan(planning, parts.frames(), config.memory.budget_mb);
  return check_budget(planning, config);
}

}  // namespace

void add_plan_command(CLI::App& app, Action& action) {
  add_command_of_run(app, "plan",
                     "Print the memory plan of a run with the same options; exit 2 where it is over budget",
                     plan, action);
}

}  // namespace stillmap
