// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/status.h"
#include "map/block_table.h"

namespace stillmap {

/// Writes what is known of each voxel, occupied or free, as an OctoMap binary tree (.bt: two bits a node,
/// Hornung et al., Autonomous Robots 34, 2013, section 3.4), not pruned. The error (WrongConfig): the map is
/// empty, or a voxel lies beyond the tree's 32768 voxels from the origin. Uses the heap: 16 bytes a voxel.
Status write_octomap(const BlockTable& blocks, double voxel_m, const std::string& path);

}  // namespace stillmap
