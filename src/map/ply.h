// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <string>

#include "core/status.h"
#include "core/time.h"
#include "core/whole_file.h"
#include "map/block_table.h"

namespace stillmap {

/// Writes the occupied voxels as a binary little-endian PLY: float x, y, z (m, map frame) and uchar red,
/// green, blue. Whole or not at all (WholeFile). The same map gives the same bytes. Gives up after
/// `timeout_ns`. Errors (exit code 1) name the file and the mend. While nobody changes the map; uses the
/// heap.
Status write_ply(const BlockTable& blocks, double voxel_m, const std::string& path,
                 Nanoseconds timeout_ns = std::numeric_limits<Nanoseconds>::max(),
                 EarlierFile* earlier = nullptr);

}  // namespace stillmap
