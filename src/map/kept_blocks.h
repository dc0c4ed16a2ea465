// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "core/arena.h"
#include "core/status.h"
#include "map/evicted_blocks.h"
#include "map/map_file.h"

namespace stillmap {

/// Blocks for which the table had no room, on disk until the map is saved: each place once. Of a place that
/// is kept a second time, since it was mapped anew and evicted again, the newer look counts, and the older
/// fills in what that does not know. After a correction, what is kept moves rigidly with its keyframe, as the
/// table's blocks do.
///
/// They lie in a file without a name, of 4168 bytes a block, which goes with the process: a map file has
/// them in it, so what outlives a crash is the last checkpoint, as with all else. Memory for finding them is
/// fixed. One thread, not the map's, since disks take their time.
class KeptBlocks {
 public:
  /// Room for so many blocks; 0: keeps none, and `lane` is null. `voxel_m` as the map's.
  KeptBlocks(Arena& arena, std::size_t capacity, double voxel_m);
  ~KeptBlocks();
  KeptBlocks(const KeptBlocks&) = delete;
  KeptBlocks& operator=(const KeptBlocks&) = delete;

  /// Before the first block: makes the file in the folder of `path`. The error (exit code 1) names it and the
  /// mend.
  Status open(const std::string& path);
  /// Where the map's thread puts what it evicts.
  EvictedBlocks* lane() { return lane_.empty() ? nullptr : lane_.data(); }
  /// Takes what waits in the lane.
  void take_all();
  void keep(const CopiedBlock& block) { put(now(), block); }
  void append_to(MapFileWriter& writer);

  /// `refused` counts blocks that are lost: there was no room, or the disk failed.
  PoolUsage usage() const { return {"kept_blocks", capacity_, generations_[current_].count, refused_}; }
  /// What went wrong first: the disk failed, or the room ended.
  const Status& status() const { return status_; }

 private:
  /// Kept blocks as of one correction.
  struct Generation {
    int file = -1;
    std::span<BlockCoordinates> places;  // by the order in the file
    std::span<std::uint32_t> slots;      // hash: order + 1, 0 = empty; a power of two
    std::size_t count = 0;
  };

  Generation& now() { return generations_[current_]; }
  std::uint32_t& slot_of(Generation& generation, BlockCoordinates at) const;
  void put(Generation& generation, const CopiedBlock& block);
  /// As `put`, in all the blocks that it comes to lie in.
  void land(Generation& generation, const CopiedBlock& block, const std::optional<Pose>& T_new_old);
  void move_all(const KeyframeMotions& motions);
  bool read(const Generation& generation, std::size_t order, CopiedBlock& block);
  bool write(const Generation& generation, std::size_t order, const CopiedBlock& block);
  void fail(const std::string& what);

  std::size_t capacity_;
  double voxel_m_;
  std::span<EvictedBlocks> lane_;  // one, or none
  std::array<Generation, 2> generations_;
  std::size_t current_ = 0;
  std::uint32_t epoch_ = 0;  // of the newest correction that the kept blocks follow
  std::uint64_t refused_ = 0;
  std::string path_;
  Status status_;
};

}  // namespace stillmap
