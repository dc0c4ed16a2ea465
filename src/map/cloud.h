// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

#include "core/cloud_point.h"
#include "map/voxel_map.h"

namespace stillmap {

/// The whole map as points in the map frame, as fine as fits into `out`; returns how many were written.
///
/// One point per occupied voxel; where those do not fit, one per occupied cube of 2 x 2 x 2 voxels, then 4,
/// then 8 (a block), at the mean place and colour of the cube's occupied voxels. Where even the blocks do not
/// fit, evenly spread ones of them. The map's thread; a few ms per million voxels; no heap.
std::size_t make_cloud(const VoxelMap& map, std::span<CloudPoint> out);

}  // namespace stillmap
