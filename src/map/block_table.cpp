// SPDX-License-Identifier: Apache-2.0
#include "map/block_table.h"

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <tuple>

namespace stillmap {

namespace {

/// A block's place in one word, never 0; 0 beyond 2^20 blocks from the origin.
std::uint64_t key_of(BlockCoordinates at) {
  constexpr std::int32_t kReach = 1 << 20;
  constexpr int kBits = 21;
  if (std::max({std::abs(at.x), std::abs(at.y), std::abs(at.z)}) >= kReach) return 0;
  const auto part = [](std::int32_t v) { return static_cast<std::uint64_t>(v + kReach); };
  return std::uint64_t{1} << 63 | part(at.x) << 2 * kBits | part(at.y) << kBits | part(at.z);
}

}  // namespace

BlockTable::BlockTable(Arena& arena, std::size_t blocks, FreeSpace* free_space, EvictedBlocks* evicted)
    : free_space_(free_space),
      evicted_blocks_(evicted),
      blocks_(arena.take<Block>("map_blocks", blocks)),
      voxels_(arena.take<Voxel>("map_voxels", blocks * kBlockVoxels)),
      T_new_old_(arena.take<Pose>("map_block_motions", blocks)),
      slots_(arena.take<int>("map_hash_slots", std::bit_ceil(2 * blocks))),
      candidates_(arena.take<Candidate>("map_eviction", blocks)),
      free_(arena.take<int>("map_free_blocks", blocks)),
      keys_(arena.take<std::atomic<std::uint64_t>>("map_published_places", blocks)),
      words_(arena.take<std::atomic<std::uint64_t>>("map_published_voxels", blocks * kWords)) {}

void BlockTable::begin_frame(BlockCoordinates camera) {
  camera_ = camera;
  picked_candidates_ = false;
}

std::size_t BlockTable::home_slot(BlockCoordinates at) const {
  return hash_of(at) & (slots_.size() - 1);
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
  const Change change(*this);
  const int index = take_index(distance2(at, camera_));
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
  if (free_space_ != nullptr) free_space_->fill(at);
  forget_published(index);
  keys_[static_cast<std::size_t>(index)].store(key_of(at), std::memory_order_release);
  set_slot(slot, index + 1);
  return index;
}

void BlockTable::set_slot(std::size_t slot, int value) {
  std::atomic_ref<int>(slots_[slot]).store(value, std::memory_order_release);
}

void BlockTable::forget_published(int index) {
  keys_[static_cast<std::size_t>(index)].store(0, std::memory_order_release);
  for (std::atomic<std::uint64_t>& word : words_.subspan(static_cast<std::size_t>(index) * kWords, kWords))
    word.store(0, std::memory_order_release);
}

void BlockTable::publish(int index) {
  const std::span<const Voxel, kBlockVoxels> from = voxels(index);
  for (std::size_t w = 0; w < kWords; ++w) {
    std::uint64_t word = 0;
    for (std::size_t v = 0; v < kVoxelsPerWord; ++v)
      word |= static_cast<std::uint64_t>(from[w * kVoxelsPerWord + v].occupancy()) << 2 * v;
    words_[static_cast<std::size_t>(index) * kWords + w].store(word, std::memory_order_release);
  }
}

void BlockTable::publish(int index, std::size_t place) {
  std::atomic<std::uint64_t>& word =
      words_[static_cast<std::size_t>(index) * kWords + place / kVoxelsPerWord];
  const std::size_t shift = 2 * (place % kVoxelsPerWord);
  const std::uint64_t others = word.load(std::memory_order_relaxed) & ~(std::uint64_t{3} << shift);
  word.store(others | static_cast<std::uint64_t>(voxels(index)[place].occupancy()) << shift,
             std::memory_order_release);
}

Occupancy BlockTable::published(BlockCoordinates at, std::size_t place) const {
  // A change takes a fraction of a microsecond, and a frame makes a few hundred at most: who meets so many in
  // a row does not hear of this voxel.
  constexpr int kTries = 1000;
  for (int i = 0; i < kTries; ++i) {
    const std::uint64_t before = hash_changes_.load(std::memory_order_acquire);
    if (before % 2 != 0) continue;
    const Occupancy there = look_up(at, place);
    if (hash_changes_.load(std::memory_order_relaxed) == before) return there;
  }
  return Occupancy::Unknown;
}

Occupancy BlockTable::look_up(BlockCoordinates at, std::size_t place) const {
  const std::uint64_t key = key_of(at);
  if (key == 0 || slots_.empty()) return Occupancy::Unknown;
  std::size_t slot = home_slot(at);
  // Bounded, since a change under way can show a ring without an end.
  for (std::size_t probes = 0; probes < slots_.size(); ++probes, slot = (slot + 1) & (slots_.size() - 1)) {
    const int entry = std::atomic_ref<int>(slots_[slot]).load(std::memory_order_acquire);
    if (entry == 0) break;
    const std::size_t index = static_cast<std::size_t>(entry - 1);
    if (keys_[index].load(std::memory_order_acquire) != key) continue;
    const std::uint64_t word =
        words_[index * kWords + place / kVoxelsPerWord].load(std::memory_order_acquire);
    return static_cast<Occupancy>(word >> 2 * (place % kVoxelsPerWord) & 3);
  }
  return free_space_ != nullptr && free_space_->free(at) ? Occupancy::Free : Occupancy::Unknown;
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

int BlockTable::take_index(std::int64_t farther_than2) {
  if (free_count_ > 0) return free_[--free_count_];
  if (static_cast<std::size_t>(used_) < blocks_.size()) return used_++;
  return evict_one_farther_than(farther_than2);
}

void BlockTable::release(int index) {
  const Change change(*this);
  unlist(index);
  forget_published(index);
  Block& b = blocks_[static_cast<std::size_t>(index)];
  occupied_voxels_ -= b.occupied;
  b.occupied = 0;
  b.state = BlockState::Empty;
  b.version = ++changes_;
  std::ranges::fill(voxels(index), Voxel{});
  free_[free_count_++] = index;
}

void BlockTable::pick_candidates() {
  picked_candidates_ = true;
  next_candidate_ = 0;
  for (int i = 0; i < used_; ++i)
    candidates_[static_cast<std::size_t>(i)] = {distance2(block(i).at, camera_), i};
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
  // Where one was released since, another block may be by now.
  const auto is_another = [this](const Candidate& c) {
    return stillmap::distance2(block(c.index).at, camera_) != c.distance2;
  };
  while (next_candidate_ < candidate_count_ && is_another(candidates_[next_candidate_])) ++next_candidate_;
  if (next_candidate_ == candidate_count_ || candidates_[next_candidate_].distance2 <= distance2)
    return kNone;
  const int index = candidates_[next_candidate_].index;
  const std::optional<Pose> motion =
      block(index).state == BlockState::Old ? std::optional(T_new_old(index)) : std::nullopt;
  if (!give_away(block(index), voxels(index), motion)) return kNone;
  ++next_candidate_;
  unlist(index);
  occupied_voxels_ -= block(index).occupied;
  ++evicted_;
  return index;
}

bool BlockTable::give_away(const Block& block, std::span<const Voxel, kBlockVoxels> voxels,
                           const std::optional<Pose>& T_new_old) {
  const auto known = [](const Voxel& v) { return v.log_odds != 0; };
  if (evicted_blocks_ == nullptr || std::ranges::none_of(voxels, known)) return true;
  const auto evicted = [&] {
    EvictedBlock made{{block, {}}, T_new_old, epoch_};
    std::ranges::copy(voxels, made.copy.voxels.begin());
    return made;
  };
  return evicted_blocks_->blocks.try_push(evicted());
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
    set_slot(slot, slots_[next]);
    slot = next;
  }
  set_slot(slot, 0);
}

}  // namespace stillmap
