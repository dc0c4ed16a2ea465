// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <span>

#include "core/check.h"
#include "stream/stream_types.h"

namespace stillmap::stream {

/// The one cloud buffer and who may touch it. The stream owns it while it sends from it, and keeps the last
/// cloud there for clients that come later; it offers the buffer when it wants a newer one; the map takes the
/// offer when it has one, fills the buffer and hands it back. Three states, no waiting on either side:
///
///   Stream --offer--> Wanted --begin--> Map --publish--> Stream
///     ^----reclaim------'
class CloudExchange {
 public:
  explicit CloudExchange(std::span<CloudPoint> memory) : memory_(memory) {}

  /// Map thread.
  bool wanted() const { return owner_.load(std::memory_order_relaxed) == Owner::Wanted; }
  /// Map thread. The whole buffer, to be followed by publish(); empty when it is not wanted (any more).
  std::span<CloudPoint> begin() {
    return move(Owner::Wanted, Owner::Map) ? memory_ : std::span<CloudPoint>();
  }
  /// Map thread.
  void publish(std::size_t points, Nanoseconds stamp_ns) {
    STILLMAP_CHECK(owner_.load(std::memory_order_relaxed) == Owner::Map && points <= memory_.size());
    points_ = points;
    stamp_ns_ = stamp_ns;
    generation_.store(generation_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    owner_.store(Owner::Stream, std::memory_order_release);
  }

  /// Stream thread. Lets the map write into the buffer from now on.
  void offer() { move(Owner::Stream, Owner::Wanted); }
  /// Stream thread. Takes an offer back; does nothing when the map has already begun.
  void reclaim() { move(Owner::Wanted, Owner::Stream); }
  /// Stream thread. Whether the cloud may be read.
  bool readable() const { return owner_.load(std::memory_order_acquire) == Owner::Stream; }
  /// Stream thread, while readable.
  std::span<const CloudPoint> points() const { return memory_.first(points_); }
  Nanoseconds stamp_ns() const { return stamp_ns_; }
  /// Stream thread. Counts the clouds; 0 before the first.
  std::uint64_t generation() const { return generation_.load(std::memory_order_relaxed); }

 private:
  enum class Owner : std::uint8_t { Stream, Wanted, Map };
  bool move(Owner from, Owner to) {
    return owner_.compare_exchange_strong(from, to, std::memory_order_acq_rel);
  }

  std::span<CloudPoint> memory_;
  std::size_t points_ = 0;
  Nanoseconds stamp_ns_ = 0;
  std::atomic<std::uint64_t> generation_{0};
  std::atomic<Owner> owner_{Owner::Stream};
};

}  // namespace stillmap::stream
