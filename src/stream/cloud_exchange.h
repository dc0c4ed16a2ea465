// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <span>

#include "core/check.h"
#include "stream/handover.h"
#include "stream/stream_types.h"

namespace stillmap::stream {

/// The one cloud buffer: the map fills it, and the stream keeps the last cloud there for clients that come
/// later.
class CloudExchange {
 public:
  explicit CloudExchange(std::span<CloudPoint> memory) : memory_(memory) {}

  /// Map thread.
  bool wanted() const { return turn_.wanted(); }
  /// Map thread. The whole buffer, to be followed by publish(); empty when it is not wanted (any more).
  std::span<CloudPoint> begin() { return turn_.begin() ? memory_ : std::span<CloudPoint>(); }
  /// Map thread. `epoch`: the newest correction that all of the points follow.
  void publish(std::size_t points, Nanoseconds stamp_ns, std::uint32_t epoch) {
    STILLMAP_CHECK(turn_.begun() && points <= memory_.size());
    points_ = points;
    stamp_ns_ = stamp_ns;
    epoch_ = epoch;
    generation_.store(generation_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    turn_.finish();
  }

  /// Stream thread; see Handover.
  void offer() { turn_.offer(); }
  void reclaim() { turn_.reclaim(); }
  bool readable() const { return turn_.readable(); }
  /// Stream thread, while readable.
  std::span<const CloudPoint> points() const { return memory_.first(points_); }
  Nanoseconds stamp_ns() const { return stamp_ns_; }
  std::uint32_t epoch() const { return epoch_; }
  /// Stream thread. Counts the clouds; 0 before the first.
  std::uint64_t generation() const { return generation_.load(std::memory_order_relaxed); }

 private:
  Handover turn_;
  std::span<CloudPoint> memory_;
  std::size_t points_ = 0;
  Nanoseconds stamp_ns_ = 0;
  std::uint32_t epoch_ = 0;
  std::atomic<std::uint64_t> generation_{0};
};

}  // namespace stillmap::stream
