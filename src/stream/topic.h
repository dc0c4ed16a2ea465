// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "core/arena.h"
#include "core/check.h"
#include "core/time.h"

namespace stillmap::stream {

/// The newest messages of one topic, encoded once for all clients; each client keeps its own place. Depth is
/// how far a client may be behind without losing any: 1 for what only the newest counts of. Stream thread.
class Topic {
 public:
  struct Item {
    Nanoseconds stamp_ns = 0;
    std::size_t bytes = 0;
  };
  Topic() = default;
  Topic(Arena& arena, const char* name, std::size_t depth, std::size_t item_bytes)
      : depth_(depth),
        item_bytes_(item_bytes),
        items_(arena.take<Item>(name, depth)),
        memory_(arena.take<std::uint8_t>(name, depth * item_bytes)) {}

  /// Where the next message is encoded, to be followed by publish().
  std::span<std::uint8_t> room() { return memory_.subspan(slot(end_) * item_bytes_, item_bytes_); }
  void publish(std::size_t bytes, Nanoseconds stamp_ns) {
    STILLMAP_CHECK(bytes <= item_bytes_);
    items_[slot(end_)] = {stamp_ns, bytes};
    ++end_;
  }

  /// What is kept is out of date: new clients do not begin with it. Only while nobody is subscribed.
  void forget() { begin_ = end_; }

  std::uint64_t depth() const { return depth_; }
  /// Where a client begins that wants at most the last `count`.
  std::uint64_t begin(std::uint64_t count) const { return std::max(begin_, end_ - std::min(end_, count)); }
  /// Messages so far; those from `end() - depth()` on are kept.
  std::uint64_t end() const { return end_; }
  const Item& item(std::uint64_t index) const { return items_[slot(index)]; }
  std::span<const std::uint8_t> payload(std::uint64_t index) const {
    return memory_.subspan(slot(index) * item_bytes_, item(index).bytes);
  }

 private:
  std::size_t slot(std::uint64_t index) const { return static_cast<std::size_t>(index % depth_); }

  std::size_t depth_ = 0, item_bytes_ = 0;
  std::span<Item> items_;
  std::span<std::uint8_t> memory_;
  std::uint64_t begin_ = 0, end_ = 0;
};

}  // namespace stillmap::stream
