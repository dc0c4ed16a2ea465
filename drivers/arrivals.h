// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <cstddef>
#include <optional>

#include "core/check.h"
#include "core/spsc_ring.h"
#include "drivers/picture_stream.h"

namespace stillmap {

/// The way of buffers from a camera library's thread to the thread that grabs, and back; by their numbers, at
/// most 16. What a library takes from the heap to queue or to free a buffer, it takes on its own thread then.
/// Nothing here takes from the heap.
class Arrivals {
 public:
  Arrivals() : signal_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {}
  ~Arrivals() { close(signal_); }
  Arrivals(const Arrivals&) = delete;
  Arrivals& operator=(const Arrivals&) = delete;

  /// The library's thread.
  void arrive(std::size_t buffer) {
    STILLMAP_CHECK(arrived_.try_push(std::size_t{buffer}));
    wake();
  }
  std::optional<std::size_t> released() { return released_.try_pop(); }
  /// Ends a wait; any thread.
  void wake() { eventfd_write(signal_, 1); }

  /// The grabbing thread.
  std::optional<std::size_t> arrived() { return arrived_.try_pop(); }
  void release(std::size_t buffer) { STILLMAP_CHECK(released_.try_push(std::size_t{buffer})); }
  /// False where nothing came before the deadline.
  bool wait(Nanoseconds deadline_ns) {
    pollfd waiting{signal_, POLLIN, 0};
    const timespec span = time_until(deadline_ns);
    const int ready = ppoll(&waiting, 1, &span, nullptr);
    eventfd_t count = 0;
    if (ready > 0) eventfd_read(signal_, &count);
    return ready != 0;
  }
  /// Forgets every buffer. The library's thread is still.
  void clear() {
    while (arrived_.try_pop()) {
    }
    while (released_.try_pop()) {
    }
  }

 private:
  int signal_;
  SpscRing<std::size_t, 16> arrived_, released_;
};

}  // namespace stillmap
