// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/un.h>

#include "core/time.h"

namespace stillmap {

/// Tells systemd (sd_notify's protocol: a datagram to the socket in $NOTIFY_SOCKET) that the service is
/// ready, alive and stopping. Without that socket every call does nothing. One thread.
class ServiceNotifier {
 public:
  ServiceNotifier();
  ~ServiceNotifier();
  ServiceNotifier(const ServiceNotifier&) = delete;
  ServiceNotifier& operator=(const ServiceNotifier&) = delete;

  void ready() { send("READY=1"); }
  /// As often as it likes: passed on four times in the watchdog's interval ($WATCHDOG_USEC).
  void alive(Nanoseconds now);
  void stopping() { send("STOPPING=1"); }

 private:
  void send(const char* state);
  int socket_ = -1;
  sockaddr_un to_{};
  unsigned to_bytes_ = 0;
  Nanoseconds interval_ns_ = 0;  // 0: no watchdog
  Nanoseconds sent_ns_ = 0;
};

}  // namespace stillmap
