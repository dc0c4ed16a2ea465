// SPDX-License-Identifier: Apache-2.0
#include "runtime/service_notifier.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <string>
#include <vector>

#include "tests/runtime/service_manager.h"

namespace stillmap {
namespace {

constexpr Nanoseconds kSecond = 1'000'000'000;

using Words = std::vector<std::string>;

TEST(ServiceNotifier, TellsReadyAliveAndStopping) {
  const std::string pid = std::to_string(getpid());
  for (const std::string& name : {"/tmp/stillmap_notify_" + pid, "@stillmap_notify_" + pid}) {
    const test::ServiceManager manager(name);
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
  const test::ServiceManager manager("@stillmap_notify_other_" + std::to_string(getpid()));
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
