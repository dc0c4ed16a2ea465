// SPDX-License-Identifier: Apache-2.0
#include "runtime/memory_lock.h"

#include <gmock/gmock.h>
#include <linux/capability.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>

namespace stillmap {
namespace {

#ifndef STILLMAP_SANITIZED

long locked_kb() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    long kb = 0;
    if (word == "VmLck:" && status >> kb) return kb;
  }
  return -1;
}

/// Of this program's code: the KB that are mapped, and those in memory.
std::pair<long, long> code_kb() {
  const std::string program = std::filesystem::read_symlink("/proc/self/exe");
  std::ifstream maps("/proc/self/smaps");
  std::pair<long, long> kb{0, 0};
  bool ours = false;
  for (std::string line; std::getline(maps, line);) {
    if (line.find(" r-xp ") != std::string::npos) ours = line.ends_with(program);
    if (ours && line.starts_with("Size:")) kb.first += std::stol(line.substr(5));
    if (ours && line.starts_with("Rss:")) {
      kb.second += std::stol(line.substr(4));
      ours = false;
    }
  }
  return kb;
}

TEST(MemoryLockDeathTest, TheProgramIsInMemory) {
  const auto check = [] {
    static_cast<void>(lock_memory());
    const auto [mapped, resident] = code_kb();
    std::_Exit(mapped > 100 && resident == mapped ? 0 : 1);
  };
  EXPECT_EXIT(check(), ::testing::ExitedWithCode(0), "");
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
