// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "core/arena.h"
#include "map/voxel_map.h"
#include "stream/stream_server.h"

namespace stillmap {

/// Answers what the stream's clients ask of the map's blocks. Map thread; no heap after construction.
class BlockFeed {
 public:
  /// `blocks`: the map's capacity.
  BlockFeed(Arena& arena, std::size_t blocks) : marks_(arena.take<Mark>("stream.block_marks", blocks)) {}

  /// About 50 KB of blocks for each client that waits for some.
  void answer(const VoxelMap& map, Nanoseconds stamp_ns, StreamServer& server);

 private:
  /// What was last seen in a slot of the map's table, and as which version.
  struct Mark {
    BlockCoordinates at;
    std::uint64_t changed_sequence = 0, version = 0;
  };
  void note_changes(const BlockTable& table);
  void answer(const VoxelMap& map, Nanoseconds stamp_ns, stream::BlockExchange& exchange) const;

  std::span<Mark> marks_;
  std::uint64_t version_ = 0;  // counts the changes
};

}  // namespace stillmap
