// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "core/fixed_vector.h"

namespace stillmap {

/// A queue from one thread to one other in which every item counts. N items in place, no locks, no waiting.
/// Each side keeps a copy of the other's index, so that the common case touches no shared cache line.
template <class T, std::size_t N>
class SpscRing {
  static_assert(N > 0 && (N & (N - 1)) == 0, "a power of two makes the index a mask");

 public:
  static constexpr std::size_t capacity() { return N; }
  /// Producer only. False, with `item` untouched, when full; the refusal is counted.
  [[nodiscard]] bool try_push(T&& item) {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head - tail_seen_ == N) {
      tail_seen_ = tail_.load(std::memory_order_acquire);
      if (head - tail_seen_ == N) {
        refused_.fetch_add(1, std::memory_order_relaxed);
        return false;
      }
    }
    items_[head & (N - 1)] = std::move(item);
    head_.store(head + 1, std::memory_order_release);
    const std::size_t used = head + 1 - tail_.load(std::memory_order_relaxed);
    if (used > high_water_.load(std::memory_order_relaxed))
      high_water_.store(used, std::memory_order_relaxed);
    return true;
  }

  /// Consumer only. The oldest item, which stays, until the next try_pop; or nullptr.
  [[nodiscard]] const T* front() {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail == head_seen_) {
      head_seen_ = head_.load(std::memory_order_acquire);
      if (tail == head_seen_) return nullptr;
    }
    return &items_[tail & (N - 1)];
  }
  /// Consumer only. The oldest item, or nothing. What moving leaves behind stays in the ring until it is
  /// overwritten: items are large, and are to let go of what they hold when they are moved from.
  [[nodiscard]] std::optional<T> try_pop() {
    if (front() == nullptr) return std::nullopt;
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    std::optional<T> item(std::move(items_[tail & (N - 1)]));
    tail_.store(tail + 1, std::memory_order_release);
    return item;
  }

  /// Any thread; exact only when the other side rests.
  std::size_t size() const {
    // The tail first: it never overtakes a head that is read later, so the difference cannot wrap.
    const std::size_t tail = tail_.load(std::memory_order_acquire);
    return std::min(head_.load(std::memory_order_acquire) - tail, N);
  }
  PoolUsage usage(const char* name) const {
    return {name, N, high_water_.load(std::memory_order_relaxed), refused_.load(std::memory_order_relaxed)};
  }

 private:
  static constexpr std::size_t kCacheLine = 64;
  /// Where the indices begin: shortly before they wrap, so that every run goes through it.
  static constexpr std::size_t kBegin = std::size_t{0} - 3 * N;
  alignas(kCacheLine) std::atomic<std::size_t> head_{kBegin};
  std::size_t tail_seen_ = kBegin;
  std::atomic<std::uint64_t> high_water_{0};
  std::atomic<std::uint64_t> refused_{0};
  alignas(kCacheLine) std::atomic<std::size_t> tail_{kBegin};
  std::size_t head_seen_ = kBegin;
  alignas(kCacheLine) std::array<T, N> items_{};
};

}  // namespace stillmap
