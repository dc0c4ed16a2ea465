// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

#include "core/arena.h"
#include "core/config.h"
#include "runtime/run_options.h"
#include "runtime/stages.h"

namespace stillmap {

/// Without a mode, a log plays in realtime.
RunMode mode_of(const RunOptions& options, bool is_log);

/// Whether the source is a camera, and no configuration says which: its lens has to be guessed.
bool lacks_profile(const RunOptions& options);

/// How many evicted blocks are kept: only a map file has room for what the table has not.
std::size_t kept_blocks(const RunOptions& options, const Config& config);

/// What a run takes part in. `log_frames`: of a log whose length is known, 0 else.
Stages::Parts parts_of(const RunOptions& options, const Config& config, bool detector, bool is_log,
                       std::size_t log_frames);

/// What a run with these options is made of; it opens a log, for its length, but no camera and no network.
/// Without a source: a log, which takes more, and as many poses as are kept of a camera. Without a camera's
/// profile: one of the size that a run guesses.
struct PlannedRun {
  Config config;
  Stages::Parts parts;
  std::string warning;  ///< what was guessed; else empty
};
Result<PlannedRun> plan_run(const RunOptions& options);

/// The memory that a run with these parts takes from its arena.
void plan_memory(Arena& planning, const Config& config, const Stages::Parts& parts);
/// The error for a plan above `memory.budget_mb`.
Status check_budget(const Arena& planning, const Config& config);

}  // namespace stillmap
