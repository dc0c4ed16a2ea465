// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "core/image.h"

namespace stillmap {

/// What the map knows of a place. Unknown: never seen, or the evidence is not yet enough.
enum class Occupancy : std::uint8_t { Unknown, Free, Occupied };

/// One cube of the map, 8 bytes.
///
/// Occupancy is the log-odds of the cube being filled, in 1/32 nat, 0 = unknown. The steps and bounds are
/// those of OctoMap (Hornung et al., Autonomous Robots 34, 2013, section 5.1: hit 0.85, miss -0.4, bounds -2
/// and 3.5), so that what is seen through fades within 6 fused frames, however long it has stood. Two hits
/// make a cube occupied: one wrong reading never shows.
struct Voxel {
  static constexpr int kHit = 27, kMiss = -13, kMin = -64, kMax = 112, kOccupied = 40;

  std::int8_t log_odds = 0;
  std::uint8_t colour_weight = 0;  ///< pictures in `colour`'s average, up to kMaxColourWeight
  std::uint16_t last_hit = 0;  ///< freshness: mark of the fused frame that last had a point in here; 0: none
  Bgr colour;
  std::uint8_t points = 0;  ///< points of that frame in here, up to 255

  bool occupied() const { return log_odds >= kOccupied; }
  Occupancy occupancy() const {
    if (occupied()) return Occupancy::Occupied;
    return log_odds < 0 ? Occupancy::Free : Occupancy::Unknown;
  }
};
static_assert(sizeof(Voxel) == 8);

/// Blocks are cubes of 8 x 8 x 8 voxels; within one, x runs fastest, then y, then z.
constexpr int kBlockEdge = 8;
constexpr int kBlockVoxels = kBlockEdge * kBlockEdge * kBlockEdge;

/// A block's place in the map frame, in whole blocks: it begins at (x, y, z) * kBlockEdge * voxel_m.
struct BlockCoordinates {
  std::int32_t x = 0, y = 0, z = 0;
  bool operator==(const BlockCoordinates&) const = default;
};

/// What the map keeps of a block beside its voxels.
struct Block {
  BlockCoordinates at;
  std::uint32_t anchor_keyframe = 0;  ///< id of the keyframe at whose fusion the block was made
  std::uint64_t fused_sequence = 0;   ///< frame that last had this block in view
  std::uint64_t changed_sequence =
      0;                       ///< frame that last changed what the block shows: occupied voxels or colours
  std::uint16_t occupied = 0;  ///< occupied voxels
};

}  // namespace stillmap
