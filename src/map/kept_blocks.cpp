// SPDX-License-Identifier: Apache-2.0
#include "map/kept_blocks.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <vector>

#include "map/landing.h"

namespace stillmap {

namespace {

static_assert(std::is_trivially_copyable_v<CopiedBlock>);

off_t offset_of(std::size_t order) {
  return static_cast<off_t>(order * sizeof(CopiedBlock));
}

int open_nameless(const std::string& path) {
  const int file = ::open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  if (file >= 0) unlink(path.c_str());
  return file;
}

}  // namespace

KeptBlocks::KeptBlocks(Arena& arena, std::size_t capacity, double voxel_m)
    : capacity_(capacity),
      voxel_m_(voxel_m),
      lane_(arena.take<EvictedBlocks>("map_evicted", capacity > 0 ? 1 : 0)) {
  for (Generation& generation : generations_) {
    generation.places = arena.take<BlockCoordinates>("map_kept_places", capacity);
    generation.slots =
        arena.take<std::uint32_t>("map_kept_slots", capacity > 0 ? std::bit_ceil(2 * capacity) : 0);
  }
}

KeptBlocks::~KeptBlocks() {
  for (const Generation& generation : generations_) {
    if (generation.file >= 0) close(generation.file);
  }
}

Status KeptBlocks::open(const std::string& path) {
  path_ = path;
  for (Generation& generation : generations_) {
    generation.file = open_nameless(path + ".evicted");
    if (generation.file < 0) {
      fail(std::strerror(errno));
      return status_;
    }
  }
  return {};
}

void KeptBlocks::take_all() {
  for (EvictedBlocks* lane = this->lane(); lane != nullptr;) {
    // Before the blocks: those evicted before it was posted are in the ring by now.
    const KeyframeMotions* motions = lane->motions.waiting();
    while (const EvictedBlock* next = lane->blocks.front()) {
      if (next->epoch > epoch_) break;
      land(now(), next->copy, next->T_new_old);
      static_cast<void>(lane->blocks.try_pop());
    }
    if (motions != nullptr) {
      move_all(*motions);
      epoch_ = motions->epoch;
      lane->motions.taken();
    } else if (lane->blocks.front() == nullptr) {
      return;
    }
  }
}

void KeptBlocks::append_to(MapFileWriter& writer) {
  CopiedBlock block;
  for (std::size_t i = 0; i < now().count; ++i) {
    if (read(now(), i, block)) writer.append(block.block, block.voxels);
  }
}

std::uint32_t& KeptBlocks::slot_of(Generation& generation, BlockCoordinates at) const {
  const std::size_t mask = generation.slots.size() - 1;
  std::size_t slot = hash_of(at) & mask;
  while (generation.slots[slot] != 0 && !(generation.places[generation.slots[slot] - 1] == at))
    slot = (slot + 1) & mask;
  return generation.slots[slot];
}

void KeptBlocks::put(Generation& generation, const CopiedBlock& block) {
  std::uint32_t& slot = slot_of(generation, block.block.at);
  if (slot != 0) {
    CopiedBlock kept;
    if (!read(generation, slot - 1, kept)) return;
    const bool newer = block.block.fused_sequence > kept.block.fused_sequence;
    CopiedBlock merged = newer ? block : kept;
    fill_in(merged.voxels, newer ? kept.voxels : block.voxels);
    write(generation, slot - 1, merged);
    return;
  }
  if (generation.count == capacity_) {
    fail("there is room for " + std::to_string(capacity_) + "; raise map.kept_blocks");
    return;
  }
  if (!write(generation, generation.count, block)) return;
  generation.places[generation.count++] = block.block.at;
  slot = static_cast<std::uint32_t>(generation.count);
}

void KeptBlocks::land(Generation& generation, const CopiedBlock& block,
                      const std::optional<Pose>& T_new_old) {
  if (!T_new_old) return put(generation, block);
  const Pose to_voxels{T_new_old->R, 1 / voxel_m_ * T_new_old->t};
  std::vector<CopiedBlock> landed;  // 8 mostly, 27 at most
  for_each_landing(block.block.at, to_voxels, [&](std::size_t from, VoxelCoordinates to) {
    if (block.voxels[from].log_odds == 0) return;
    auto there = std::ranges::find(landed, block_of(to), [](const CopiedBlock& b) { return b.block.at; });
    if (there == landed.end()) {
      there = landed.insert(landed.end(), {block.block, {}});
      there->block.at = block_of(to);
      there->block.fused_sequence = 0;  // it goes where nothing was seen since
    }
    there->voxels[place_in_block(to)] = block.voxels[from];
  });
  for (const CopiedBlock& piece : landed) put(generation, piece);
}

void KeptBlocks::move_all(const KeyframeMotions& motions) {
  Generation& next = generations_[1 - current_];
  next.count = 0;
  std::ranges::fill(next.slots, 0u);
  CopiedBlock block;
  for (std::size_t i = 0; i < now().count; ++i) {
    if (read(now(), i, block)) land(next, block, motions.motion_of(block.block.anchor_keyframe));
  }
  if (ftruncate(now().file, 0) != 0) fail(std::strerror(errno));
  current_ = 1 - current_;
}

bool KeptBlocks::read(const Generation& generation, std::size_t order, CopiedBlock& block) {
  errno = EIO;
  const bool whole = pread(generation.file, &block, sizeof(block), offset_of(order)) == sizeof(block);
  if (!whole) fail(std::strerror(errno));
  return whole;
}

bool KeptBlocks::write(const Generation& generation, std::size_t order, const CopiedBlock& block) {
  errno = ENOSPC;  // what a disk that takes a part of it has to say
  const bool whole = pwrite(generation.file, &block, sizeof(block), offset_of(order)) == sizeof(block);
  if (!whole) fail(std::string(std::strerror(errno)) + "; free some space");
  return whole;
}

void KeptBlocks::fail(const std::string& what) {
  ++refused_;
  if (status_.ok())
    status_ =
        Error{ExitCode::RunFailed, path_ + ": blocks that memory has no room for cannot be kept: " + what +
                                       ", or set map.kept_blocks to 0 to do without"};
}

}  // namespace stillmap
