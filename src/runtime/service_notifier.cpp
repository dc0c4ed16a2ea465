// SPDX-License-Identifier: Apache-2.0
#include "runtime/service_notifier.h"

#include <sys/socket.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <cstring>

namespace stillmap {

ServiceNotifier::ServiceNotifier() {
  const char* path = std::getenv("NOTIFY_SOCKET");
  if (path == nullptr || (path[0] != '/' && path[0] != '@')) return;
  const std::size_t length = std::strlen(path);
  if (length >= sizeof(to_.sun_path)) return;
  to_.sun_family = AF_UNIX;
  std::memcpy(to_.sun_path, path, length);
  if (path[0] == '@') to_.sun_path[0] = '\0';  // Linux's abstract names
  to_bytes_ = static_cast<unsigned>(offsetof(sockaddr_un, sun_path) + length);
  socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const char* interval_us = std::getenv("WATCHDOG_USEC");
  const char* pid = std::getenv("WATCHDOG_PID");  // whose watchdog it is
  if (interval_us != nullptr && (pid == nullptr || std::atol(pid) == getpid()))
    interval_ns_ = 1000 * std::atoll(interval_us);
}

ServiceNotifier::~ServiceNotifier() {
  if (socket_ >= 0) close(socket_);
}

void ServiceNotifier::alive(Nanoseconds now) {
  if (interval_ns_ <= 0 || now - sent_ns_ < interval_ns_ / 4) return;
  send("WATCHDOG=1");
  sent_ns_ = now;
}

void ServiceNotifier::send(const char* state) {
  if (socket_ < 0) return;
  // A manager that does not listen is no reason to stop.
  static_cast<void>(sendto(socket_, state, std::strlen(state), MSG_NOSIGNAL,
                           reinterpret_cast<const sockaddr*>(&to_), to_bytes_));
}

}  // namespace stillmap
