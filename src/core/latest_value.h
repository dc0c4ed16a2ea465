// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <utility>

namespace stillmap {

/// The newest value from one thread to one other: a triple buffer with one atomic exchange on each side.
/// The writer never waits and never overwrites what the reader looks at.
template <class T>
class LatestValue {
 public:
  /// Writer only. Publishes `value` and gives back what it displaced before anyone read it (an empty T
  /// otherwise), so that a displaced frame handle is dropped by the thread that knows why.
  T publish(T value) {
    slots_[write_] = std::move(value);
    const std::uint32_t before = shared_.exchange(write_ | kFresh, std::memory_order_acq_rel);
    write_ = before & kIndex;
    T displaced = std::exchange(slots_[write_], T{});
    if ((before & kFresh) != 0) {
      ++displaced_;
      return displaced;
    }
    return T{};
  }

  /// Reader only. True when a newer value than the one in `value()` was taken over; the older one is cleared.
  bool refresh() {
    if ((shared_.load(std::memory_order_relaxed) & kFresh) == 0) return false;
    slots_[read_] = T{};
    read_ = shared_.exchange(read_, std::memory_order_acq_rel) & kIndex;
    ++generation_;
    return true;
  }
  /// Reader only. The value taken over by the last refresh(); generation() counts them, 0 before the first.
  const T& value() const { return slots_[read_]; }
  T& value() { return slots_[read_]; }
  std::uint64_t generation() const { return generation_; }
  /// Writer only: how many values nobody read.
  std::uint64_t displaced() const { return displaced_; }

 private:
  static constexpr std::uint32_t kIndex = 3, kFresh = 4;
  std::array<T, 3> slots_{};
  alignas(64) std::atomic<std::uint32_t> shared_{1};
  alignas(64) std::uint32_t write_ = 0;
  std::uint64_t displaced_ = 0;
  alignas(64) std::uint32_t read_ = 2;
  std::uint64_t generation_ = 0;
};

}  // namespace stillmap
