// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>

#include "core/check.h"

namespace stillmap::stream {

/// Who may touch a buffer that the stream shares with one other thread, the maker of what goes into it. The
/// stream owns it while it reads, and offers it when it wants something newer; the maker takes the offer when
/// it has something, fills the buffer and hands it back. Three states, no waiting on either side:
///
///   Stream --offer--> Wanted --begin--> Maker --finish--> Stream
///     ^----reclaim------'
class Handover {
 public:
  /// Maker.
  bool wanted() const { return owner_.load(std::memory_order_relaxed) == Owner::Wanted; }
  /// Maker. Whether the buffer is its own from now on, until finish().
  bool begin() { return move(Owner::Wanted, Owner::Maker); }
  /// Maker.
  void finish() {
    STILLMAP_CHECK(begun());
    owner_.store(Owner::Stream, std::memory_order_release);
  }
  bool begun() const { return owner_.load(std::memory_order_relaxed) == Owner::Maker; }

  /// Stream thread. Lets the maker write into the buffer from now on.
  void offer() { move(Owner::Stream, Owner::Wanted); }
  /// Stream thread. Takes an offer back; does nothing when the maker has already begun.
  void reclaim() { move(Owner::Wanted, Owner::Stream); }
  /// Stream thread. Whether the buffer may be read.
  bool readable() const { return owner_.load(std::memory_order_acquire) == Owner::Stream; }

 private:
  enum class Owner : std::uint8_t { Stream, Wanted, Maker };
  bool move(Owner from, Owner to) {
    return owner_.compare_exchange_strong(from, to, std::memory_order_acq_rel);
  }
  std::atomic<Owner> owner_{Owner::Stream};
};

}  // namespace stillmap::stream
