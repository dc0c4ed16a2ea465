// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "core/check.h"

namespace stillmap {

/// Up to N values in place. Trivially copyable where T is, so that it can cross threads in a ring. A
/// contiguous range: it passes as a std::span.
template <class T, std::size_t N>
class FixedVector {
  static_assert(std::is_trivially_copyable_v<T>, "values cross threads by memcpy");

 public:
  static constexpr std::size_t capacity() { return N; }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  void clear() { size_ = 0; }
  /// False, and nothing is stored, when full.
  [[nodiscard]] bool try_push_back(const T& value) {
    if (size_ == N) return false;
    items_[size_++] = value;
    return true;
  }
  void truncate(std::size_t size) { size_ = std::min(size_, size); }
  T& operator[](std::size_t i) { return items_[i]; }
  const T& operator[](std::size_t i) const { return items_[i]; }
  T* begin() { return items_.data(); }
  T* end() { return items_.data() + size_; }
  const T* begin() const { return items_.data(); }
  const T* end() const { return items_.data() + size_; }

 private:
  std::array<T, N> items_{};
  std::size_t size_ = 0;
};

/// What a pool, ring or container reports of itself.
struct PoolUsage {
  const char* name = "";
  std::uint64_t capacity = 0;
  std::uint64_t high_water = 0;
  std::uint64_t refused = 0;
};

/// A vector over memory that an Arena lent: capacity fixed at start, counts what it had to refuse. A
/// contiguous range: it passes as a std::span.
template <class T>
class ArenaVector {
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T>);

 public:
  ArenaVector() = default;
  explicit ArenaVector(std::span<T> memory) : memory_(memory) {}
  std::size_t capacity() const { return memory_.size(); }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  bool full() const { return size_ == memory_.size(); }
  void clear() { size_ = 0; }
  [[nodiscard]] bool try_push_back(const T& value) {
    if (size_ == memory_.size()) {
      ++refused_;
      return false;
    }
    memory_[size_++] = value;
    high_water_ = std::max(high_water_, size_);
    return true;
  }
  void pop_back() {
    STILLMAP_CHECK(size_ > 0);
    --size_;
  }
  void resize_down(std::size_t size) { size_ = std::min(size_, size); }
  T& operator[](std::size_t i) { return memory_[i]; }
  const T& operator[](std::size_t i) const { return memory_[i]; }
  T* begin() { return memory_.data(); }
  T* end() { return memory_.data() + size_; }
  const T* begin() const { return memory_.data(); }
  const T* end() const { return memory_.data() + size_; }
  PoolUsage usage(const char* name) const { return {name, memory_.size(), high_water_, refused_}; }

 private:
  std::span<T> memory_;
  std::size_t size_ = 0;
  std::size_t high_water_ = 0;
  std::uint64_t refused_ = 0;
};

}  // namespace stillmap
