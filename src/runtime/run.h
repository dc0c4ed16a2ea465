// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "core/arena.h"
#include "core/config.h"
#include "runtime/run_context.h"
#include "runtime/run_options.h"
#include "runtime/stages.h"

namespace stillmap {

/// The whole of `stillmap run`: configuration, source, pipeline, outputs. Ends on the source's end, SIGINT or
/// SIGTERM with every output complete.
Status run(const RunOptions& options);

/// What the end of a run means: RunFailed where the source was lost, UnreadableInput where no frame could be
/// used or tracked and nobody asked for the end.
Status run_outcome(const RunContext& context);

/// What a run with these options is made of; it opens a log, for its length, but no camera and no network.
/// Without a source: a log, which takes more, and as many poses as are kept of a camera.
struct PlannedRun {
  Config config;
  Stages::Parts parts;
};
Result<PlannedRun> plan_run(const RunOptions& options);

/// The memory that a run with these parts takes from its arena.
void plan_memory(Arena& planning, const Config& config, const Stages::Parts& parts);
/// The error for a plan above `memory.budget_mb`.
Status check_budget(const Arena& planning, const Config& config);

}  // namespace stillmap
