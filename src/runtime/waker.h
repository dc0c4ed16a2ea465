// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <ctime>

#include "core/time.h"

namespace stillmap {

/// Who waits looks up as often: a lost wake would cost this much and no more, and a wish to stop is seen.
constexpr Nanoseconds kIdleWait = 50'000'000;

/// Lets one thread sleep until others have work for it, without a lock: a futex on a counter.
///
/// The sleeper takes a ticket, looks for work, and waits with that ticket; a wake between the two makes the
/// wait return at once, so none is lost. `wake` costs a system call only while somebody sleeps.
class Waker {
 public:
  std::uint32_t ticket() const { return wakes_.load(std::memory_order_acquire); }
  void wake() {
    wakes_.fetch_add(1, std::memory_order_seq_cst);
    if (sleepers_.load(std::memory_order_seq_cst) > 0) {
      syscall(SYS_futex, reinterpret_cast<std::uint32_t*>(&wakes_), FUTEX_WAKE_PRIVATE, 1 << 30, nullptr,
              nullptr, 0);
    }
  }
  /// Returns when woken since `ticket`, and after `timeout` at the latest.
  void wait(std::uint32_t ticket, Nanoseconds timeout) {
    if (timeout <= 0) return;
    const timespec span{static_cast<time_t>(timeout / 1'000'000'000),
                        static_cast<long>(timeout % 1'000'000'000)};
    sleepers_.fetch_add(1, std::memory_order_seq_cst);
    if (wakes_.load(std::memory_order_seq_cst) == ticket) {
      syscall(SYS_futex, reinterpret_cast<std::uint32_t*>(&wakes_), FUTEX_WAIT_PRIVATE, ticket, &span,
              nullptr, 0);
    }
    sleepers_.fetch_sub(1, std::memory_order_seq_cst);
  }

 private:
  static_assert(sizeof(std::atomic<std::uint32_t>) == sizeof(std::uint32_t));
  // Wraps within weeks, and is only compared for being the same. It begins shortly before.
  std::atomic<std::uint32_t> wakes_{~std::uint32_t{0} - 100};
  std::atomic<std::uint32_t> sleepers_{0};
};

}  // namespace stillmap
