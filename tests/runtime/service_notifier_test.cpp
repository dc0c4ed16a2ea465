// SPDX-License-Identifier: Apache-2.0
#include "runtime/service_notifier.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <iterator>
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
  const auto descriptors = [] {
    return std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {});
  };
  /// How many descriptors a notifier holds that has said everything, and that it leaves none.
  const auto held_while_telling = [&] {
    const auto before = descriptors();
    std::ptrdiff_t held = 0;
    {
      setenv("WATCHDOG_USEC", "2000000", 1);
      setenv("WATCHDOG_PID", std::to_string(getpid()).c_str(), 1);
      ServiceNotifier notifier;
      notifier.ready();
      notifier.alive(kSecond);
      notifier.stopping();
      held = descriptors() - before;
    }
    EXPECT_EQ(descriptors(), before);
    return held;
  };
  {
    const test::ServiceManager elsewhere("stillmap_notify_" + std::to_string(getpid()));  // no absolute path
    EXPECT_EQ(held_while_telling(), 0);
    EXPECT_EQ(elsewhere.heard(), Words{});
  }
  {
    const std::string longest = "@" + std::string(106, 'x');
    const test::ServiceManager of_its_beginning(longest);
    EXPECT_EQ(held_while_telling(), 1);
    EXPECT_EQ(of_its_beginning.heard().size(), 3u) << "as long as a name may be";
    setenv("NOTIFY_SOCKET", (longest + "and_longer").c_str(), 1);
    EXPECT_EQ(held_while_telling(), 0);
    EXPECT_EQ(of_its_beginning.heard(), Words{});
  }
  EXPECT_EQ(held_while_telling(), 0) << "no manager named";
  setenv("NOTIFY_SOCKET", "", 1);
  EXPECT_EQ(held_while_telling(), 0);
  setenv("NOTIFY_SOCKET", "/nobody/listens", 1);
  EXPECT_EQ(held_while_telling(), 1) << "who may begin to listen later";
  for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) unsetenv(name);
}

}  // namespace
}  // namespace stillmap
