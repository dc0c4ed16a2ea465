// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <span>

#include "core/arena.h"
#include "core/image.h"
#include "core/time.h"

namespace stillmap {

/// One RGB-D frame. Pixels live in the FramePool; the driver fills colour and depth in place.
struct FrameSlot {
  std::uint64_t sequence = 0;
  int camera = 0;
  Nanoseconds colour_ns = 0;  ///< exposure of the colour picture, on the source's clock
  Nanoseconds depth_ns = 0;   ///< exposure of the depth picture, on the source's clock
  Nanoseconds due_ns = 0;     ///< when the frame was due, on the monotonic clock: latency counts from here
  ImageView<Bgr> colour;
  ImageView<std::uint16_t> depth;  ///< registered to colour; in the camera's depth units; 0 = no reading
};

class FramePool;

/// A counted hold on one frame. Move-only; a second holder is made explicitly by `share()`. The frame returns
/// to its pool when the last holder lets go, on whatever thread that happens.
class FrameHandle {
 public:
  FrameHandle() = default;
  FrameHandle(FrameHandle&& other) noexcept : entry_(other.entry_) { other.entry_ = nullptr; }
  FrameHandle& operator=(FrameHandle&& other) noexcept;
  FrameHandle(const FrameHandle&) = delete;
  FrameHandle& operator=(const FrameHandle&) = delete;
  ~FrameHandle() { reset(); }

  explicit operator bool() const { return entry_ != nullptr; }
  const FrameSlot& operator*() const;
  const FrameSlot* operator->() const { return &**this; }
  /// The frame, to fill: only while this is its one holder (checked).
  FrameSlot& writable();
  FrameHandle share() const;
  void reset();

 private:
  friend class FramePool;
  struct Entry {
    FrameSlot slot;
    std::atomic<std::int32_t> holders{0};
  };
  explicit FrameHandle(Entry* entry) : entry_(entry) {}
  Entry* entry_ = nullptr;
};

/// A fixed number of frames of one size. Only the capture thread acquires, by scanning for a frame that
/// nobody holds: there is no free list, so there is nothing to go wrong in one.
class FramePool {
 public:
  FramePool(Arena& arena, std::size_t frames, int width, int height);
  ~FramePool();
  FramePool(const FramePool&) = delete;
  FramePool& operator=(const FramePool&) = delete;

  /// Capture thread only. Empty, and counted as refused, when every frame is held.
  [[nodiscard]] FrameHandle acquire();
  PoolUsage usage() const;

 private:
  std::size_t count_;
  std::unique_ptr<FrameHandle::Entry[]>
      entries_;  // made at start; atomics have no place in the arena's plain items
  std::size_t next_ = 0;
  std::atomic<std::uint64_t> high_water_{0}, refused_{0};
};

}  // namespace stillmap
