// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/geometry.h"
#include "core/status.h"
#include "core/time.h"

namespace stillmap {

/// Where the camera was at one moment: T_world_camera takes points of the camera (x right, y down, z forward)
/// to the world. Metres.
struct StampedPose {
  Nanoseconds stamp_ns = 0;  ///< on the log's clock
  Pose T_world_camera;
};

/// Reads a trajectory in the TUM RGB-D benchmark's format: `stamp tx ty tz qx qy qz qw` a line, in seconds
/// and metres. Comes back sorted by stamp; of poses with one stamp the last line counts, as in the
/// benchmark's scripts. The error (UnreadableInput) names file and line: eight columns, finite numbers, a
/// quaternion of unit length, and at least one pose are expected.
Result<std::vector<StampedPose>> read_trajectory(const std::string& path);

/// Writes the same format with a fixed number of decimals (stamps to 1 ns, positions to 1 um, quaternions to
/// 1e-8 with qw >= 0), so that equal poses are equal bytes. `header_line` (one line, no '#') names the frames
/// and the convention and comes first as a comment. Whole or not at all (WholeFile).
Status write_trajectory(const std::string& path, std::span<const StampedPose> poses,
                        const std::string& header_line);

}  // namespace stillmap
