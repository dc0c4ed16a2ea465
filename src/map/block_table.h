// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/arena.h"
#include "map/evicted_blocks.h"
#include "map/free_space.h"
#include "map/voxel.h"

namespace stillmap {

/// The blocks of the map in memory fixed at start, found by their coordinates through a hash table with open
/// addressing (linear probing, at most half full). One thread.
///
/// When every block is taken, a new one takes the place of the block farthest from the camera. One pass over
/// the headers, at most once per frame and only when it is needed, picks the farthest sixteenth of all
/// blocks, and the frame's new blocks use these up in turn: an insertion never pays for a scan, and the
/// choice is exact where a probe of a few blocks would now and then hit one in view. A block only gives way
/// to a nearer one, else the new one is refused: a view that does not fit keeps its near part, without
/// thrashing. Where evicted blocks are kept, one with anything in it gives way only when there is room for it
/// on the way there.
///
/// Other threads may ask `published`: two bits a voxel beside the voxels, which the map's thread stores
/// atomically, and a hash that is read under a sequence count.
class BlockTable {
 public:
  static constexpr int kNone = -1;

  /// `free_space` is told of new blocks, `evicted` gets those that give way; both must outlive the table.
  /// Null: there is none.
  BlockTable(Arena& arena, std::size_t blocks, FreeSpace* free_space = nullptr,
             EvictedBlocks* evicted = nullptr);

  /// To be called before the first `find_or_add` of a frame. `camera` is the camera's place in whole blocks.
  void begin_frame(BlockCoordinates camera);
  /// The index of the block at `at`, current or else old, or kNone.
  int find(BlockCoordinates at) const;
  /// Whether `find` finds this block: it is not empty, and no current block has taken its place.
  bool found(int index) const;
  /// The current block at `at`; makes an empty one where there is none, before which an old one there gives
  /// way. kNone, counted, where it is refused. May reuse the index of any other block.
  int find_or_add(BlockCoordinates at, std::uint32_t anchor_keyframe);

  /// Blocks in use have the indices 0 to size() - 1; there are empty ones among them.
  int size() const { return used_; }
  const Block& block(int index) const { return blocks_[static_cast<std::size_t>(index)]; }
  std::span<Voxel, kBlockVoxels> voxels(int index) {
    return voxels_.subspan(static_cast<std::size_t>(index) * kBlockVoxels).first<kBlockVoxels>();
  }
  std::span<const Voxel, kBlockVoxels> voxels(int index) const {
    return voxels_.subspan(static_cast<std::size_t>(index) * kBlockVoxels).first<kBlockVoxels>();
  }
  /// Notes that frame `sequence` was fused into a block, which now holds `occupied` occupied voxels.
  void note_fused(int index, std::uint64_t sequence, bool changed, int occupied);

  /// Blocks made from now on are of this epoch.
  void begin_epoch(std::uint32_t epoch) { epoch_ = epoch; }
  void make_old(int index) { blocks_[static_cast<std::size_t>(index)].state = BlockState::Old; }
  /// Of an old block: from where it is to where it belongs, m.
  Pose& T_new_old(int index) { return T_new_old_[static_cast<std::size_t>(index)]; }
  /// Makes a block empty and its index free.
  void release(int index);
  /// Whether blocks that gave way are still on the way to where they are kept.
  bool evicted_wait() const { return evicted_blocks_ != nullptr && evicted_blocks_->blocks.size() > 0; }
  /// Hands a block to where evicted ones are kept. False, counted there, without room on the way; true where
  /// none are kept, or nothing is known of it.
  bool give_away(const Block& block, std::span<const Voxel, kBlockVoxels> voxels,
                 const std::optional<Pose>& T_new_old);

  /// Tells `published` of all voxels of a block, or of one.
  void publish(int index);
  void publish(int index, std::size_t place);
  /// What is known of a voxel; where there is no block, of the air around it. Any thread.
  Occupancy published(BlockCoordinates at, std::size_t place) const;

  /// Counts whatever changed what a block shows; never goes back.
  std::uint64_t changes() const { return changes_; }
  std::uint64_t occupied_voxels() const { return occupied_voxels_; }
  std::uint64_t evicted() const { return evicted_; }
  /// `refused` counts how often there was no block to take.
  PoolUsage usage() const {
    return {"map_blocks", blocks_.size(), static_cast<std::size_t>(used_), refused_};
  }
  std::size_t blocks_used() const { return static_cast<std::size_t>(used_) - free_count_; }

 private:
  struct Candidate {
    std::int64_t distance2 = 0;
    int index = 0;
  };

  static constexpr std::size_t kVoxelsPerWord = 32, kWords = kBlockVoxels / kVoxelsPerWord;

  /// While this lives, the hash and what is published may not fit each other.
  class Change {
   public:
    explicit Change(BlockTable& table) : count_(table.hash_changes_) {
      count_.store(count_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    }
    ~Change() { count_.store(count_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }
    Change(const Change&) = delete;
    Change& operator=(const Change&) = delete;

   private:
    std::atomic<std::uint64_t>& count_;
  };
  void set_slot(std::size_t slot, int value);
  void forget_published(int index);
  Occupancy look_up(BlockCoordinates at, std::size_t place) const;

  std::size_t home_slot(BlockCoordinates at) const;
  /// The slot that holds `at`, or the empty one where it belongs.
  std::size_t slot_of(BlockCoordinates at) const;
  void erase_slot(std::size_t slot);
  /// Takes a block out of the hash, unless another has its place there.
  void unlist(int index);
  /// An index for a new block at this distance, or kNone.
  int take_index(std::int64_t distance2);
  void pick_candidates();
  /// The index of the block that gave way, or kNone.
  int evict_one_farther_than(std::int64_t distance2);

  FreeSpace* free_space_;
  EvictedBlocks* evicted_blocks_;
  std::span<Block> blocks_;
  std::span<Voxel> voxels_;
  std::span<Pose> T_new_old_;                    // by index, of those that are old
  std::span<int> slots_;                         // index + 1 of a block, 0 = empty; a power of two
  std::span<Candidate> candidates_;              // of this frame, farthest first
  std::span<int> free_;                          // indices of empty blocks
  std::span<std::atomic<std::uint64_t>> keys_;   // each block's place, packed; 0: none
  std::span<std::atomic<std::uint64_t>> words_;  // kWords a block
  std::atomic<std::uint64_t> hash_changes_{0};   // odd while one is under way
  std::size_t free_count_ = 0;
  int used_ = 0;
  std::uint32_t epoch_ = 0;
  BlockCoordinates camera_;
  bool picked_candidates_ = false;
  std::size_t next_candidate_ = 0, candidate_count_ = 0;
  std::uint64_t occupied_voxels_ = 0, evicted_ = 0, refused_ = 0, changes_ = 0;
};

/// An occupied voxel: its centre in m in the map frame, its colour and its block.
struct OccupiedVoxel {
  float x = 0, y = 0, z = 0;
  Bgr colour;
  const Block& block;
};

/// Calls `visit(const OccupiedVoxel&)` for each occupied voxel, block by block in the order of their memory:
/// the same fusions give the same order.
template <class Visitor>
void for_each_occupied(const BlockTable& table, double voxel_m, Visitor&& visit) {
  const auto centre_m = [voxel_m](std::int32_t block, int voxel) {
    return static_cast<float>((kBlockEdge * static_cast<double>(block) + voxel + 0.5) * voxel_m);
  };
  for (int i = 0; i < table.size(); ++i) {
    const Block& block = table.block(i);
    if (block.occupied == 0) continue;
    const std::span<const Voxel, kBlockVoxels> voxels = table.voxels(i);
    for (int v = 0; v < kBlockVoxels; ++v) {
      const Voxel& voxel = voxels[static_cast<std::size_t>(v)];
      if (!voxel.occupied()) continue;
      visit(OccupiedVoxel{centre_m(block.at.x, v % kBlockEdge),
                          centre_m(block.at.y, v / kBlockEdge % kBlockEdge),
                          centre_m(block.at.z, v / (kBlockEdge * kBlockEdge)), voxel.colour, block});
    }
  }
}

}  // namespace stillmap
