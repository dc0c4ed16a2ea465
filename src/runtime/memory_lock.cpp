// SPDX-License-Identifier: Apache-2.0
#include "runtime/memory_lock.h"

#include <linux/capability.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace stillmap {

namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

bool has_lock_capability() {
  __user_cap_header_struct header{.version = _LINUX_CAPABILITY_VERSION_3, .pid = 0};
  std::array<__user_cap_data_struct, 2> data{};
  return syscall(SYS_capget, &header, data.data()) == 0 && (data[0].effective & (1U << CAP_IPC_LOCK)) != 0;
}

}  // namespace

std::string lock_memory() {
  if constexpr (kSanitized) return {};
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  const std::string mend =
      "; grant CAP_IPC_LOCK or an unlimited memlock limit (ulimit -l, systemd: LimitMEMLOCK=infinity); "
      "running "
      "unlocked";
  // With a limit, locking may succeed now and make a later allocation fail.
  if (limit.rlim_cur != RLIM_INFINITY && !has_lock_capability())
    return "memory.lock: this process may lock " + std::to_string(limit.rlim_cur / 1024) + " KB" + mend;
  if (mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0) return {};
  return std::string("memory.lock: ") + std::strerror(errno) + mend;
}

}  // namespace stillmap
