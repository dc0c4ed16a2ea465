// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/geometry.h"
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

/// The squared distance between two blocks, in blocks.
constexpr std::int64_t distance2(BlockCoordinates a, BlockCoordinates b) {
  const std::int64_t x = std::int64_t{a.x} - b.x, y = std::int64_t{a.y} - b.y, z = std::int64_t{a.z} - b.z;
  return x * x + y * y + z * z;
}

/// Each axis is multiplied by an odd number of its own; the high bits, which every input bit reaches, choose.
constexpr std::uint32_t hash_of(BlockCoordinates at) {
  const std::uint64_t mixed = static_cast<std::uint32_t>(at.x) * 0x9e3779b97f4a7c15u ^
                              static_cast<std::uint32_t>(at.y) * 0xc2b2ae3d27d4eb4fu ^
                              static_cast<std::uint32_t>(at.z) * 0x165667b19e3779f9u;
  return static_cast<std::uint32_t>((mixed ^ mixed >> 32) * 0x9e3779b97f4a7c15u >> 32);
}

/// A voxel's place in the map frame, in whole voxels.
struct VoxelCoordinates {
  std::int32_t x = 0, y = 0, z = 0;
};
/// The voxel around a point whose coordinates are in voxels.
inline VoxelCoordinates voxel_at(Vec3 p_voxels) {
  return {static_cast<std::int32_t>(std::floor(p_voxels.x)),
          static_cast<std::int32_t>(std::floor(p_voxels.y)),
          static_cast<std::int32_t>(std::floor(p_voxels.z))};
}

/// The block around a voxel, and the voxel's place within it.
constexpr BlockCoordinates block_of(std::int32_t x, std::int32_t y, std::int32_t z) {
  static_assert(kBlockEdge == 8);
  return {x >> 3, y >> 3, z >> 3};
}
constexpr std::size_t place_in_block(std::int32_t x, std::int32_t y, std::int32_t z) {
  return static_cast<std::size_t>((x & 7) + 8 * (y & 7) + 64 * (z & 7));
}
constexpr BlockCoordinates block_of(VoxelCoordinates v) {
  return block_of(v.x, v.y, v.z);
}
constexpr std::size_t place_in_block(VoxelCoordinates v) {
  return place_in_block(v.x, v.y, v.z);
}

/// Current: as the newest poses have it. Old: made at poses that a correction has moved since; it shows until
/// its turn comes, and nothing is fused into it. Empty: given back.
enum class BlockState : std::uint8_t { Current, Old, Empty };

/// What the map keeps of a block beside its voxels.
struct Block {
  BlockCoordinates at;
  std::uint32_t anchor_keyframe = 0;  ///< id of the keyframe at whose fusion the block was made
  std::uint64_t fused_sequence = 0;   ///< frame that last could tell something of it
  std::uint64_t changed_sequence =
      0;                         ///< frame that last changed what the block shows: occupied voxels or colours
  std::uint64_t version = 0;     ///< the table's `changes()` when what the block shows last changed
  std::uint32_t made_epoch = 0;  ///< correction epoch in which it was made
  std::uint16_t occupied = 0;    ///< occupied voxels
  BlockState state = BlockState::Current;
};

/// A block on its own.
struct CopiedBlock {
  Block block;
  std::array<Voxel, kBlockVoxels> voxels;
};

/// What one look at a block does not know, another, older one fills in.
inline void fill_in(std::span<Voxel, kBlockVoxels> voxels, std::span<const Voxel, kBlockVoxels> older) {
  for (std::size_t v = 0; v < kBlockVoxels; ++v) {
    if (voxels[v].occupancy() == Occupancy::Unknown && older[v].log_odds != 0) voxels[v] = older[v];
  }
}

}  // namespace stillmap
