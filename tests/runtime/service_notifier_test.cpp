// SPDX-License-Identifier: Apache-2.0
#include "runtime/service_notifier.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

namespace stillmap {
namespace {

constexpr Nanoseconds kSecond = 1'000'000'000;

/// The service manager's end, at a path or at an abstract name, and the environment that it gives.
struct Manager {
  explicit Manager(const std::string& name) : fd(socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)), path(name) {
    sockaddr_un at{};
    at.sun_family = AF_UNIX;
    std::memcpy(at.sun_path, name.data(), name.size());
    if (name[0] == '@') at.sun_path[0] = '\0';
    EXPECT_EQ(bind(fd, reinterpret_cast<sockaddr*>(&at),
                   static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size())),
              0);
    setenv("NOTIFY_SOCKET", name.c_str(), 1);
  }
  ~Manager() {
    close(fd);
    unlink(path.c_str());
    for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) unsetenv(name);
  }
  std::vector<std::string> heard() const {
    std::vector<std::string> words;
    char word[64];
    for (ssize_t n = 0; (n = recv(fd, word, sizeof(word), 0)) > 0;) words.emplace_back(word, n);
    return words;
  }
  int fd;
  std::string path;
};
using Words = std::vector<std::string>;

TEST(ServiceNotifier, TellsReadyAliveAndStopping) {
  const std::string pid = std::to_string(getpid());
  for (const std::string& name : {"/tmp/stillmap_notify_" + pid, "@stillmap_notify_" + pid}) {
    const Manager manager(name);
    setenv("WATCHDOG_USEC", "2000000", 1);
    setenv("WATCHDOG_PID", pid.c_str(), 1);
    ServiceNotifier notifier;
    notifier.ready();
    EXPECT_EQ(manager.heard(), (Words{"READY=1"}));
    for (int i = 0; i < 100; ++i) notifier.alive(kSecond + i * kSecond / 100);  // a second
    EXPECT_EQ(manager.heard(), (Words{"WATCHDOG=1", "WATCHDOG=1"}));
    notifier.stopping();
    EXPECT_EQ(manager.heard(), (Words{"STOPPING=1"}));
  }
}

TEST(ServiceNotifier, AnotherProcesssWatchdogIsNotOurs) {
  const Manager manager("@stillmap_notify_other_" + std::to_string(getpid()));
  setenv("WATCHDOG_USEC", "2000000", 1);
  setenv("WATCHDOG_PID", "1", 1);
  ServiceNotifier notifier;
  notifier.alive(kSecond);
  EXPECT_TRUE(manager.heard().empty());
}

TEST(ServiceNotifier, IsSilentWithoutAManagerAndWhereItCannotBeReached) {
  for (const std::string& name : {std::string(), std::string("relative"), std::string("/nobody/listens"),
                                  "/" + std::string(200, 'x')}) {
    setenv("NOTIFY_SOCKET", name.c_str(), 1);
    ServiceNotifier notifier;
    notifier.ready();
    notifier.alive(kSecond);
    notifier.stopping();
  }
  unsetenv("NOTIFY_SOCKET");
}

}  // namespace
}  // namespace stillmap
