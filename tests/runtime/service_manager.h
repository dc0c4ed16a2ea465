// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

namespace stillmap::test {

/// The service manager's end, at a path or at an abstract name, and the environment that it gives.
struct ServiceManager {
  explicit ServiceManager(const std::string& name)
      : fd(socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)), path(name) {
    sockaddr_un at{};
    at.sun_family = AF_UNIX;
    std::memcpy(at.sun_path, name.data(), name.size());
    if (name[0] == '@') at.sun_path[0] = '\0';
    EXPECT_EQ(bind(fd, reinterpret_cast<sockaddr*>(&at),
                   static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size())),
              0);
    setenv("NOTIFY_SOCKET", name.c_str(), 1);
  }
  ~ServiceManager() {
    close(fd);
    unlink(path.c_str());
    for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) unsetenv(name);
  }
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;
  /// Since the last call.
  std::vector<std::string> heard() const {
    std::vector<std::string> words;
    char word[64];
    for (ssize_t n = 0; (n = recv(fd, word, sizeof(word), 0)) > 0;) words.emplace_back(word, n);
    return words;
  }
  int fd;
  std::string path;
};
}  // namespace stillmap::test
