// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace stillmap {

/// Realtime: a log on the wall clock, one thread a stage, dropping as a camera would. Lockstep: every frame
/// through every stage in turn on one thread; the same input gives the same bytes.
enum class RunMode { Lockstep, Realtime };

/// What `stillmap run` was asked for. Empty paths: not asked for.
struct RunOptions {
  std::vector<std::string> configs, overrides;
  std::string source;
  RunMode mode = RunMode::Realtime;
  int detector_delay = 0;  ///< frames, lockstep only
  int detector_every = 1;  ///< frames, lockstep only
  double duration_s = 0;   ///< 0: until the source ends
  std::string trajectory, trajectory_final, map, report, groundtruth;
  std::string record;  ///< folder for a log of what the source delivers
  std::string listen;  ///< overrides stream.listen
};

}  // namespace stillmap
