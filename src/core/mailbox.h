// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>

#include "core/check.h"

namespace stillmap {

/// One large value from one thread to one other, filled and read in place. Neither side waits: while the
/// reader has not taken the last value, there is no room for the next.
template <class T>
class Mailbox {
 public:
  /// Writer only. Where to put the next value, or null while the last one waits to be read.
  T* room() { return full_.load(std::memory_order_acquire) ? nullptr : &value_; }
  /// Writer only, when the value from `room` is whole.
  void post() {
    STILLMAP_CHECK(!full_.load(std::memory_order_relaxed));
    full_.store(true, std::memory_order_release);
  }

  /// Reader only. The value that waits, or null.
  const T* waiting() const { return full_.load(std::memory_order_acquire) ? &value_ : nullptr; }
  /// Reader only, done with `waiting`: there is room again.
  void taken() { full_.store(false, std::memory_order_release); }

 private:
  std::atomic<bool> full_{false};
  T value_{};
};

}  // namespace stillmap
