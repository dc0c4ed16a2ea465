// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/arena.h"
#include "core/camera.h"
#include "core/status.h"
#include "core/whole_file.h"
#include "map/block_table.h"

namespace stillmap {

/// What a map belongs to.
struct MapFacts {
  double voxel_m = 0;
  std::uint64_t camera_hash = 0;  ///< of the calibration, see `calibration_hash`
  bool z_is_up = false;           ///< the map's z axis is known to point away from gravity
};

/// The same for cameras with equal intrinsics, lens and depth unit, whatever their names.
std::uint64_t calibration_hash(const CameraModel& camera);

/// Writes a .stillmap file block by block. Flat and little endian:
///   header  "stillmap", u32 version (3), u32 bytes of a block, f64 voxel_m, u64 calibration hash, u64 1
///           where z is up
///   blocks  i32 x, y, z (whole blocks), u32 anchor keyframe, u64 and u64 sequence of the last fusion and
///           change, then 512 voxels of 8 bytes as `Voxel` has them, x fastest
///   keyframes  bytes that the tracker wrote, see docs/map.md
///   footer  u64 blocks, u64 bytes of keyframes, u64 FNV-1a over all before
/// Of a block that comes twice, the one that was fused last counts, and the other fills in what it does not
/// know. Whole or not at all (WholeFile). Any one thread.
class MapFileWriter {
 public:
  MapFileWriter(const std::string& path, const MapFacts& facts,
                Nanoseconds timeout_ns = std::numeric_limits<Nanoseconds>::max(),
                EarlierFile* earlier = nullptr);
  void append(const Block& block, std::span<const Voxel, kBlockVoxels> voxels);
  /// After all blocks; may come in parts.
  void append_keyframes(std::span<const std::byte> bytes);
  Status finish();

 private:
  WholeFile file_;
  std::uint64_t blocks_ = 0, keyframe_bytes_ = 0;
};

/// All blocks of a map that nobody changes meanwhile.
void append_blocks(const BlockTable& blocks, MapFileWriter& writer);

/// A map as a file holds it, in memory of its own.
struct MapFile {
  MapFacts facts;
  std::unique_ptr<Arena> memory;
  std::unique_ptr<BlockTable> blocks;
  std::vector<std::byte> keyframes;
};
/// The error (UnreadableInput) says whether the file is missing, no map, of another version, cut off or
/// damaged, and the mend.
Result<MapFile> read_map_file(const std::string& path);

}  // namespace stillmap
