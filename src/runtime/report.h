// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "eval/accuracy.h"
#include "runtime/run_context.h"

namespace stillmap {

/// What a report tells beside what the pipeline itself counted.
struct ReportFacts {
  std::string source, config_sha256, model, model_sha256;
  std::uint64_t planned_bytes = 0, rss_start_kb = 0, major_faults = 0;  // the last: of the run
  Nanoseconds process_start_ns = 0, run_start_ns = 0, run_end_ns = 0;
  double cpu_s = 0;
  std::optional<Accuracy> accuracy;
  double share_in_ellipsoid = 0;  ///< as eval/consistency.h has it; with `accuracy` only
};

/// The run as JSON with the keys of the project's contract (docs/report.md). After the run.
std::string make_report(const RunContext& context, const ReportFacts& facts);

/// The report's part `accuracy` alone, on one line; null where a figure does not exist.
std::string accuracy_json(const Accuracy& accuracy);

}  // namespace stillmap
