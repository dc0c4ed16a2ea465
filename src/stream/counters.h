// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>

#include "stream/stream_types.h"

namespace stillmap::stream {

/// What StreamStats is read from: written by the stream thread, read by any.
struct Counters {
  using Counter = std::atomic<std::uint64_t>;
  Counter clients{0}, clients_peak{0}, clients_refused{0}, clients_unwelcome{0}, clients_given_up{0},
      messages_sent{0}, messages_dropped{0}, bytes_sent{0}, bad_messages{0}, pictures_sent{0},
      pictures_withheld{0};

  static void add(Counter& counter, std::uint64_t n) { counter.fetch_add(n, std::memory_order_relaxed); }
  static std::uint64_t read(const Counter& counter) { return counter.load(std::memory_order_relaxed); }

  void client_came() {
    add(clients, 1);
    clients_peak.store(std::max(read(clients_peak), read(clients)), std::memory_order_relaxed);
  }
  void client_left() { clients.fetch_sub(1, std::memory_order_relaxed); }

  StreamStats snapshot() const {
    return {.clients = read(clients),
            .clients_peak = read(clients_peak),
            .clients_refused = read(clients_refused),
            .clients_unwelcome = read(clients_unwelcome),
            .clients_given_up = read(clients_given_up),
            .messages_sent = read(messages_sent),
            .messages_dropped = read(messages_dropped),
            .bytes_sent = read(bytes_sent),
            .bad_messages = read(bad_messages),
            .pictures_sent = read(pictures_sent),
            .pictures_withheld = read(pictures_withheld)};
  }
};

}  // namespace stillmap::stream
