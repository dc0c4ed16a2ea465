// SPDX-License-Identifier: Apache-2.0
#include "map/block_table.h"

#include <algorithm>
#include <bit>
#include <tuple>

namespace stillmap {

BlockTable::BlockTable(Arena& arena, std::size_t blocks)
    : blocks_(arena.take<Block>("map_blocks", blocks)),
      voxels_(arena.take<Voxel>("map_voxels", blocks * kBlockVoxels)),
      slots_(arena.take<int>("map_hash_slots", std::bit_ceil(2 * blocks))),
      candidates_(arena.take<Candidate>("map_eviction", blocks)),
      free_(arena.take<int>("map_free_blocks", blocks)) {}

void BlockTable::begin_frame(BlockCoordinates camera) {
  camera_ = camera;
  picked_candidates_ = false;
}

std::size_t BlockTable::home_slot(BlockCoordinates at) const {
  // Each axis is multiplied by an odd number of its own; the high bits, which every input bit reaches,
  // choose.
  const std::uint64_t mixed = static_cast<std::uint32_t>(at.x) * 0x9e3779b97f4a7c15u ^
                              static_cast<std::uint32_t>(at.y) * 0xc2b2ae3d27d4eb4fu ^
                              static_cast<std::uint32_t>(at.z) * 0x165667b19e3779f9u;
  return static_cast<std::size_t>((mixed ^ mixed >> 32) * 0x9e3779b97f4a7c15u >> 32) & (slots_.size() - 1);
}

std::size_t BlockTable::slot_of(BlockCoordinates at) const {
  std::size_t slot = home_slot(at);
  while (slots_[slot] != 0 && !(block(slots_[slot] - 1).at == at)) slot = (slot + 1) & (slots_.size() - 1);
  return slot;
}

int BlockTable::find(BlockCoordinates at) const {
  return slots_.empty() ? kNone : slots_[slot_of(at)] - 1;
}

bool BlockTable::found(int index) const {
  return block(index).state != BlockState::Empty && find(block(index).at) == index;
}

int BlockTable::find_or_add(BlockCoordinates at, std::uint32_t anchor_keyframe) {
  std::size_t slot = slot_of(at);
  if (slots_[slot] != 0 && block(slots_[slot] - 1).state == BlockState::Current) return slots_[slot] - 1;
  const int index = take_index(distance2_to_camera(at));
  if (index == kNone) {
    ++refused_;
    return kNone;
  }
  slot = slot_of(at);  // evicting moves entries
  Block& made = blocks_[static_cast<std::size_t>(index)];
  made = {};
  made.at = at;
  made.anchor_keyframe = anchor_keyframe;
  made.version = ++changes_;
  made.made_epoch = epoch_;
  std::ranges::fill(voxels(index), Voxel{});
  slots_[slot] = index + 1;
  return index;
}

void BlockTable::note_fused(int index, std::uint64_t sequence, bool changed, int occupied) {
  Block& b = blocks_[static_cast<std::size_t>(index)];
  b.fused_sequence = sequence;
  if (changed) {
    b.changed_sequence = sequence;
    b.version = ++changes_;
  }
  occupied_voxels_ += static_cast<std::uint64_t>(occupied);
  occupied_voxels_ -= b.occupied;
  b.occupied = static_cast<std::uint16_t>(occupied);
}

int BlockTable::take_index(std::int64_t distance2) {
  if (free_count_ > 0) return free_[--free_count_];
  if (static_cast<std::size_t>(used_) < blocks_.size()) return used_++;
  return evict_one_farther_than(distance2);
}

void BlockTable::release(int index) {
  unlist(index);
  Block& b = blocks_[static_cast<std::size_t>(index)];
  occupied_voxels_ -= b.occupied;
  b.occupied = 0;
  b.state = BlockState::Empty;
  b.version = ++changes_;
  std::ranges::fill(voxels(index), Voxel{});
  free_[free_count_++] = index;
}

std::int64_t BlockTable::distance2_to_camera(BlockCoordinates at) const {
  const std::int64_t x = std::int64_t{at.x} - camera_.x, y = std::int64_t{at.y} - camera_.y,
                     z = std::int64_t{at.z} - camera_.z;
  return x * x + y * y + z * z;
}

void BlockTable::pick_candidates() {
  picked_candidates_ = true;
  next_candidate_ = 0;
  for (int i = 0; i < used_; ++i)
    candidates_[static_cast<std::size_t>(i)] = {distance2_to_camera(block(i).at), i};
  candidate_count_ = std::max<std::size_t>(1, blocks_.size() / 16);
  // Ties go by index, so that the same run evicts the same blocks everywhere.
  const auto farther = [](const Candidate& a, const Candidate& b) {
    return std::tuple(-a.distance2, a.index) < std::tuple(-b.distance2, b.index);
  };
  const auto end = candidates_.begin() + static_cast<std::ptrdiff_t>(candidate_count_);
  std::nth_element(candidates_.begin(), end, candidates_.end(), farther);
  std::sort(candidates_.begin(), end, farther);
}

int BlockTable::evict_one_farther_than(std::int64_t distance2) {
  if (!picked_candidates_) pick_candidates();
  if (next_candidate_ == candidate_count_ || candidates_[next_candidate_].distance2 <= distance2)
    return kNone;
  const int index = candidates_[next_candidate_++].index;
  unlist(index);
  occupied_voxels_ -= block(index).occupied;
  ++evicted_;
  return index;
}

void BlockTable::unlist(int index) {
  const std::size_t slot = slot_of(block(index).at);
  if (slots_[slot] == index + 1) erase_slot(slot);
}

void BlockTable::erase_slot(std::size_t slot) {
  // Backward-shift deletion: later entries of the run close the gap, so that no tombstones slow the search
  // down.
  const std::size_t mask = slots_.size() - 1;
  for (std::size_t next = (slot + 1) & mask; slots_[next] != 0; next = (next + 1) & mask) {
    const std::size_t home = home_slot(block(slots_[next] - 1).at);
    if (((next - home) & mask) < ((next - slot) & mask)) continue;  // it may not move before its home
    slots_[slot] = slots_[next];
    slot = next;
  }
  slots_[slot] = 0;
}

}  // namespace stillmap
