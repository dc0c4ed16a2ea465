// SPDX-License-Identifier: Apache-2.0
#include "core/stderr_text.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdint>
#include <cstdio>

namespace stillmap {

namespace {

/// Whether all of it was taken. What poll() calls ready takes this much without waiting: a pipe has room for
/// PIPE_BUF bytes then. The descriptor is not made non-blocking, since other processes may share it.
bool write_ready(std::string_view text) {
  while (!text.empty()) {
    pollfd ready{.fd = STDERR_FILENO, .events = POLLOUT, .revents = 0};
    if (poll(&ready, 1, 0) != 1 || (ready.revents & POLLOUT) == 0) return false;
    const ssize_t written =
        write(STDERR_FILENO, text.data(), std::min(text.size(), static_cast<std::size_t>(PIPE_BUF)));
    if (written < 0 && errno != EINTR) return false;
    if (written > 0) text.remove_prefix(static_cast<std::size_t>(written));
  }
  return true;
}

}  // namespace

void write_stderr(std::string_view text) noexcept {
  static std::atomic<std::uint64_t> lost{0};
  if (const std::uint64_t count = lost.exchange(0); count > 0) {
    std::array<char, 96> words;
    const int size =
        std::snprintf(words.data(), words.size(), "%llu messages are missing here: nobody read stderr\n",
                      static_cast<unsigned long long>(count));
    if (!write_ready({words.data(), static_cast<std::size_t>(size)})) {
      lost += count + 1;
      return;
    }
  }
  if (!write_ready(text)) ++lost;
}

}  // namespace stillmap
