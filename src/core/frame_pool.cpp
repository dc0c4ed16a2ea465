// SPDX-License-Identifier: Apache-2.0
#include "core/frame_pool.h"

namespace stillmap {

FrameHandle& FrameHandle::operator=(FrameHandle&& other) noexcept {
  if (this != &other) {
    reset();
    entry_ = other.entry_;
    other.entry_ = nullptr;
  }
  return *this;
}

const FrameSlot& FrameHandle::operator*() const {
  STILLMAP_CHECK(entry_ != nullptr);
  return entry_->slot;
}

FrameSlot& FrameHandle::writable() {
  STILLMAP_CHECK(entry_ != nullptr && entry_->holders.load(std::memory_order_relaxed) == 1);
  return entry_->slot;
}

FrameHandle FrameHandle::share() const {
  STILLMAP_CHECK(entry_ != nullptr);
  entry_->holders.fetch_add(1, std::memory_order_relaxed);
  return FrameHandle(entry_);
}

void FrameHandle::reset() {
  if (entry_ == nullptr) return;
  // Release: the last holder's reads are done before capture may write into the frame again.
  const std::int32_t before = entry_->holders.fetch_sub(1, std::memory_order_acq_rel);
  STILLMAP_CHECK(before > 0);
  entry_ = nullptr;
}

FramePool::FramePool(Arena& arena, std::size_t frames, int width, int height)
    : count_(frames), entries_(arena.planning() ? nullptr : new FrameHandle::Entry[frames]) {
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  const std::span<Bgr> colour = arena.take<Bgr>("frames.colour", frames * pixels);
  const std::span<std::uint16_t> depth = arena.take<std::uint16_t>("frames.depth", frames * pixels);
  if (arena.planning()) return;
  for (std::size_t i = 0; i < frames; ++i) {
    FrameSlot& slot = entries_[i].slot;
    slot.colour = {colour.data() + i * pixels, width, height, width};
    slot.depth = {depth.data() + i * pixels, width, height, width};
  }
}

FramePool::~FramePool() {
  for (std::size_t i = 0; entries_ && i < count_; ++i) STILLMAP_CHECK(entries_[i].holders.load() == 0);
}

FrameHandle FramePool::acquire() {
  std::uint64_t held = 1;
  FrameHandle taken;
  for (std::size_t i = 0; i < count_; ++i) {
    FrameHandle::Entry& entry = entries_[(next_ + i) % count_];
    if (entry.holders.load(std::memory_order_acquire) != 0) {
      ++held;
    } else if (!taken) {
      entry.holders.store(1, std::memory_order_relaxed);
      taken = FrameHandle(&entry);
    }
  }
  if (!taken) {
    refused_.fetch_add(1, std::memory_order_relaxed);
    return taken;
  }
  next_ = (next_ + 1) % count_;
  if (held > high_water_.load(std::memory_order_relaxed)) high_water_.store(held, std::memory_order_relaxed);
  return taken;
}

PoolUsage FramePool::usage() const {
  return {"frames", count_, high_water_.load(std::memory_order_relaxed),
          refused_.load(std::memory_order_relaxed)};
}

}  // namespace stillmap
