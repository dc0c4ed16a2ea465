// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>

namespace stillmap {

/// Whose turn it is with a piece of memory that the tracker and a worker use by turns: neither waits for the
/// other, and no two threads ever look at it at once. Lock-free.
class Turns {
 public:
  /// The tracker's: nothing is out, and nothing is to be taken back.
  bool at_rest() const { return turn() == Turn::Rest; }
  /// The tracker's: the worker has done its part.
  bool done() const { return turn() == Turn::Done; }
  /// The tracker gives the memory away; the worker's from now on, until it is done.
  void offer() { turn_.store(Turn::Offered, std::memory_order_release); }
  /// The tracker has taken what it wanted.
  void rest() { turn_.store(Turn::Rest, std::memory_order_release); }

  /// Any thread: there is work.
  bool waits() const { return turn() == Turn::Offered; }
  /// The worker gives it back.
  void finish() { turn_.store(Turn::Done, std::memory_order_release); }

 private:
  enum class Turn : std::uint8_t { Rest, Offered, Done };
  Turn turn() const { return turn_.load(std::memory_order_acquire); }
  std::atomic<Turn> turn_{Turn::Rest};
};

}  // namespace stillmap
