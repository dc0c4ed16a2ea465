// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <string>

#include "core/status.h"
#include "core/time.h"
#include "map/voxel_map.h"

namespace stillmap {

/// Writes the occupied voxels as a binary little-endian PLY: float x, y, z (m, map frame) and uchar red,
/// green, blue. Whole or not at all: written beside `path` as `path`.tmp, synced, then renamed over it. The
/// same map gives the same bytes. Gives up after `timeout_ns`. Errors (exit code 1) name the file and the
/// mend. The map's thread, at shutdown and checkpoints; uses the heap.
Status write_ply(const VoxelMap& map, const std::string& path,
                 Nanoseconds timeout_ns = std::numeric_limits<Nanoseconds>::max());

}  // namespace stillmap
