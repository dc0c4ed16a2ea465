// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/arena.h"
#include "core/copy_pass.h"
#include "map/block_table.h"

namespace stillmap {

/// Hands the map's blocks to another thread while it goes on being fused, a few hundred at a time. Each block
/// is whole; blocks of one pass may be some frames apart, one that was moved meanwhile may come twice or not
/// at all.
class MapCopier : public CopyPass<CopiedBlock> {
 public:
  static constexpr std::size_t kBlocksAtOnce = 256;  // about 0.2 ms of copying

  explicit MapCopier(Arena& arena) : CopyPass(arena.take<CopiedBlock>("map_copies", kBlocksAtOnce)) {}

  /// Map's thread, after each fusion.
  void serve(const BlockTable& table);

 private:
  int next_block_ = 0;  // map's thread
};

}  // namespace stillmap
