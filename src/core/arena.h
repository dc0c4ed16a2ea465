// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <span>
#include <type_traits>

#include "core/fixed_vector.h"

namespace stillmap {

/// One line of the memory plan: `count` items of `item_bytes` for `name`.
struct PlanLine {
  const char* name = "";
  std::uint64_t count = 0;
  std::uint64_t item_bytes = 0;
  std::uint64_t bytes() const { return count * item_bytes; }
};

/// All memory of the pipeline, taken once at start and given out in pieces that live as long as it does.
///
/// The same code that builds the stages makes the plan: an arena of kind Planning gives out nothing and
/// only adds up. So the plan that `stillmap plan` prints cannot differ from what a run takes.
class Arena {
 public:
  /// An arena that only counts; `take` returns empty spans.
  Arena() = default;
  /// An arena over `bytes` of zeroed, page-backed memory. Aborts when the machine has none to give.
  explicit Arena(std::size_t bytes);
  ~Arena();
  Arena(const Arena&) = delete;
  Arena& operator=(const Arena&) = delete;

  bool planning() const { return memory_ == nullptr; }
  std::size_t bytes_planned() const { return used_; }
  std::span<const PlanLine> lines() const { return {lines_.begin(), lines_.size()}; }

  /// `count` value-initialised items on a cache line of their own, or an empty span while planning. `name`
  /// must be a literal. Asking for more than the plan holds is a bug and aborts.
  template <class T>
  std::span<T> take(const char* name, std::size_t count) {
    static_assert(std::is_trivially_destructible_v<T>, "the arena never runs destructors");
    static_assert(alignof(T) <= kAlignment);
    void* memory = take_bytes(name, count, sizeof(T));
    if (memory == nullptr) return {};
    T* items = static_cast<T*>(memory);
    std::uninitialized_value_construct_n(items, count);
    return {items, count};
  }

 private:
  static constexpr std::size_t kAlignment = 64;
  void* take_bytes(const char* name, std::size_t count, std::size_t item_bytes);

  std::byte* memory_ = nullptr;
  std::size_t capacity_ = 0;
  std::size_t used_ = 0;
  FixedVector<PlanLine, 256> lines_;
};

}  // namespace stillmap
