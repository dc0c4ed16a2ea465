// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

#include "core/geometry.h"
#include "core/mailbox.h"
#include "core/spsc_ring.h"
#include "map/keyframe_poses.h"
#include "map/voxel.h"

namespace stillmap {

/// A block that gave way to a nearer one.
struct EvictedBlock {
  CopiedBlock copy;
  std::optional<Pose> T_new_old;  ///< from where it was to where it belongs, m; nothing where it stays
  std::uint32_t epoch = 0;        ///< of the correction that `T_new_old` follows
};

/// What leaves the table, on its way from the map's thread to the one that keeps it (KeptBlocks), and the
/// corrections that move what was kept. A full ring keeps blocks from giving way: none is lost on the way.
struct EvictedBlocks {
  SpscRing<EvictedBlock, 256> blocks;  // as many as a frame may evict of the default table
  Mailbox<KeyframeMotions> motions;    ///< posted before the first block of its epoch
};

}  // namespace stillmap
