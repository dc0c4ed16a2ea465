// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace stillmap {

/// From now on what spdlog is told goes to stderr by write_stderr(), so that a reader who stalls holds up
/// nobody. Only the thread of run() logs.
void log_to_stderr();

}  // namespace stillmap
