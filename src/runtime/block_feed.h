// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "map/voxel_map.h"
#include "stream/stream_server.h"

namespace stillmap {

/// Answers what the stream's clients ask of the map's blocks: about 50 KB of blocks for each client that
/// waits for some. Map thread; no heap.
void feed_blocks(const VoxelMap& map, Nanoseconds stamp_ns, StreamServer& server);

}  // namespace stillmap
