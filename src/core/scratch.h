// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <span>

namespace stillmap {

/// Memory that a picture library gets in place of the heap: one block made at open, given out from either
/// end, and taken back at once when a picture is done. `front` is what lives for one picture, `back` what
/// lives as long as the codec. Untouched pages cost nothing. One thread.
class Scratch {
 public:
  /// A block of its own.
  explicit Scratch(std::size_t bytes)
      : own_(new (std::align_val_t(kAlignment)) std::byte[bytes / kAlignment * kAlignment]),
        memory_(own_.get()),
        back_(bytes / kAlignment * kAlignment) {}
  /// Somebody else's block, such as a piece of the arena.
  explicit Scratch(std::span<std::byte> memory)
      : memory_(memory.data()), back_(memory.size() / kAlignment * kAlignment) {}

  /// Null when full, which the library reports as its own out-of-memory error.
  void* take_front(std::size_t bytes) {
    if (bytes > back_ - front_ || rounded(bytes) > back_ - front_) return nullptr;
    std::byte* taken = memory_ + front_;
    front_ += rounded(bytes);
    return taken;
  }
  void* take_back(std::size_t bytes) {
    if (bytes > back_ - front_ || rounded(bytes) > back_ - front_) return nullptr;
    back_ -= rounded(bytes);
    return memory_ + back_;
  }
  void clear_front() { front_ = 0; }

 private:
  static constexpr std::size_t kAlignment = 64;  // what libjpeg-turbo's vector code wants, twice
  static constexpr std::size_t rounded(std::size_t bytes) {
    return (bytes + kAlignment - 1) / kAlignment * kAlignment;
  }
  struct Free {
    void operator()(std::byte* p) const { ::operator delete[](p, std::align_val_t(kAlignment)); }
  };

  std::unique_ptr<std::byte[], Free> own_;
  std::byte* memory_;
  std::size_t front_ = 0, back_;
};

}  // namespace stillmap
