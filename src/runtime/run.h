// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/status.h"
#include "runtime/run_context.h"
#include "runtime/run_options.h"

namespace stillmap {

/// The whole of `stillmap run`: configuration, source, pipeline, outputs. Ends on the source's end, SIGINT or
/// SIGTERM with every output complete.
Status run(const RunOptions& options);

/// What the end of a run means: RunFailed where the source was lost, UnreadableInput where no frame could be
/// used or tracked and nobody asked for the end.
Status run_outcome(const RunContext& context);

}  // namespace stillmap
