// SPDX-License-Identifier: Apache-2.0
#include "runtime/memory_lock.h"

#include <gmock/gmock.h>
#include <linux/capability.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>

namespace stillmap {
namespace {

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

long locked_kb() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    long kb = 0;
    if (word == "VmLck:" && status >> kb) return kb;
  }
  return -1;
}

TEST(MemoryLockDeathTest, LocksOrWarnsWithTheMend) {
  const auto check = [] {
    const std::string warning = lock_memory();
    const bool good = warning.empty() ? locked_kb() > 1000
                                      : warning.find("CAP_IPC_LOCK") != std::string::npos && locked_kb() == 0;
    std::_Exit(good ? 0 : 1);
  };
  EXPECT_EXIT(check(), ::testing::ExitedWithCode(0), "");
}

TEST(MemoryLockDeathTest, ALimitWithoutTheCapabilityIsAWarning) {
  const auto check = [] {
    const rlimit little{64 << 10, 64 << 10};
    setrlimit(RLIMIT_MEMLOCK, &little);
    __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
    __user_cap_data_struct none[2]{};
    syscall(SYS_capset, &header, none);
    const std::string warning = lock_memory();
    std::_Exit(
        warning.find("may lock 64 KB; grant CAP_IPC_LOCK") != std::string::npos && locked_kb() == 0 ? 0 : 1);
  };
  EXPECT_EXIT(check(), ::testing::ExitedWithCode(0), "");
}

#endif

}  // namespace
}  // namespace stillmap
