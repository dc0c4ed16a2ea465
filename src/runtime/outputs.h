// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "runtime/report.h"
#include "runtime/run_context.h"

namespace stillmap {

/// Refuses before the run what could only fail after it.
Status check_outputs(const RunOptions& options, const Config& config);

/// After the run: writes what it was asked for, and puts the accuracy into `facts` where there is ground
/// truth. A run without a pose leaves earlier outputs as they are, but for the report, which counts why. The
/// first error; what comes after it is written all the same. `stamps`: of the log's first pass, which alone
/// ground truth knows.
Status write_outputs(RunContext& context, ReportFacts& facts, const std::vector<StampedPose>& groundtruth,
                     const std::vector<Nanoseconds>& stamps);

/// The run in a line or two of the log.
void say_summary(const RunContext& context, const ReportFacts& facts);

}  // namespace stillmap
