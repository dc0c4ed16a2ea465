// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <span>

#include "core/arena.h"
#include "map/block_table.h"

namespace stillmap {

/// Hands the map's blocks to another thread while it goes on being fused: a few hundred at a time, copied by
/// the map's thread when the reader has asked, through one buffer. Each block is whole; blocks of one pass
/// may be some frames apart, one that was moved meanwhile may come twice or not at all. Neither side waits.
class MapCopier {
 public:
  struct CopiedBlock {
    Block block;
    std::array<Voxel, kBlockVoxels> voxels;
  };
  static constexpr std::size_t kBlocksAtOnce = 256;  // about 0.2 ms of copying

  explicit MapCopier(Arena& arena) : copies_(arena.take<CopiedBlock>("map_copies", kBlocksAtOnce)) {}

  /// Map's thread, after each fusion.
  void serve(const BlockTable& table);

  /// Reader's thread. Asks for the first blocks, when no pass is under way.
  void begin();
  /// Reader's thread. The next blocks, or none yet (empty and not `last`). `next` gives them back.
  struct Copies {
    std::span<const CopiedBlock> blocks;
    bool last = false;
  };
  Copies ready() const;
  /// Reader's thread, done with what `ready` gave: asks for the next blocks, or ends the pass.
  void next();

 private:
  enum class State : int { Idle, WantFirst, WantMore, Ready };
  std::span<CopiedBlock> copies_;
  std::atomic<State> state_{State::Idle};  // the reader's, but in the Want states the map's
  int next_block_ = 0;                     // map's thread
  std::size_t copied_ = 0;                 // as state_
  bool last_ = false;                      // as state_
};

}  // namespace stillmap
