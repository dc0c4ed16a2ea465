// SPDX-License-Identifier: Apache-2.0
#include "runtime/memory_use.h"

#include <sys/resource.h>

#include <fstream>
#include <string>

namespace stillmap {

namespace {

std::uint64_t status_field(const std::string& name) {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    std::uint64_t kb = 0;
    if (word == name && status >> kb) return kb;
  }
  return 0;
}

}  // namespace

std::uint64_t resident_kb() {
  return status_field("VmRSS:");
}
std::uint64_t resident_peak_kb() {
  return status_field("VmHWM:");
}
std::uint64_t major_faults() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_majflt);
}

}  // namespace stillmap
