// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace stillmap {

/// Live: a camera, one thread a stage; a stage that is behind skips to the newest frame. Realtime: a log in
/// the same way, on the wall clock. Fast: a log through the same threads as fast as they can, every frame.
/// Lockstep: every frame through every stage in turn on one thread; the same input gives the same bytes.
enum class RunMode { Live, Realtime, Fast, Lockstep };
inline constexpr std::array<RunMode, 4> kRunModes{RunMode::Live, RunMode::Realtime, RunMode::Fast,
                                                  RunMode::Lockstep};
const char* to_string(RunMode mode);

/// The detector as lockstep stands in for it: its boxes come so many frames late, and it looks at every n-th
/// frame. The default is as measured live on two cores, where the int8 network takes 14 to 19 ms: every
/// frame, and its boxes are there for the next one.
struct DetectorTiming {
  int delay = 1;
  int every = 1;
};

/// What `stillmap run` was asked for. Empty paths: not asked for.
struct RunOptions {
  std::vector<std::string> configs, overrides;
  std::string source;
  std::optional<RunMode> mode;  ///< none: live for a camera, realtime for a log
  DetectorTiming detector;      ///< lockstep only
  /// Lockstep only: frames that an adjustment's result misses the frame after its own by. As measured live,
  /// where it takes 2 to 3 ms.
  int adjust_delay = 0;
  int loops = 1;          ///< times that a log is played, forwards and backwards in turn
  double duration_s = 0;  ///< 0: until the source ends
  std::string trajectory, trajectory_final, map, report, groundtruth;
  std::string resume;  ///< .stillmap file to go on in; where it is `map` and not there yet, a new map begins
  std::string record;  ///< folder for a log of what the source delivers
  std::string listen;  ///< overrides stream.listen
};

}  // namespace stillmap
