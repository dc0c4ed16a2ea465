// SPDX-License-Identifier: Apache-2.0
#include "runtime/memory_lock.h"

#include <link.h>
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

#ifdef STILLMAP_SANITIZED
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

/// Reads the program's own code and constants in, by a byte of each page: they are the first object's.
int touch_program(dl_phdr_info* program, std::size_t, void*) {
  constexpr std::size_t kPage = 4096;
  for (int i = 0; i < program->dlpi_phnum; ++i) {
    const auto& segment = program->dlpi_phdr[i];
    if (segment.p_type != PT_LOAD || (segment.p_flags & PF_R) == 0) continue;
    // An address of this process, which the linker knows and C++ does not.
    // NOLINTNEXTLINE(performance-no-int-to-ptr)
    const auto* bytes = reinterpret_cast<const volatile char*>(program->dlpi_addr + segment.p_vaddr);
    for (std::size_t at = 0; at < segment.p_memsz; at += kPage) static_cast<void>(bytes[at]);
  }
  return 1;  // the libraries that follow are read where they are used
}

}  // namespace

bool has_capability(unsigned number) {
  __user_cap_header_struct header{.version = _LINUX_CAPABILITY_VERSION_3, .pid = 0};
  std::array<__user_cap_data_struct, 2> data{};
  return syscall(SYS_capget, &header, data.data()) == 0 &&
         (data[number / 32].effective & (1U << number % 32)) != 0;
}

std::string lock_memory() {
  if constexpr (kSanitized) return {};
  dl_iterate_phdr(touch_program, nullptr);
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  const std::string mend =
      "; grant CAP_IPC_LOCK or an unlimited memlock limit (ulimit -l, systemd: LimitMEMLOCK=infinity); "
      "running "
      "unlocked";
  // With a limit, locking may succeed now and make a later allocation fail.
  if (limit.rlim_cur != RLIM_INFINITY && !has_capability(CAP_IPC_LOCK))
    return "memory.lock: this process may lock " + std::to_string(limit.rlim_cur / 1024) + " KB" + mend;
  if (mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0) return {};
  return std::string("memory.lock: ") + std::strerror(errno) + mend;
}

}  // namespace stillmap
