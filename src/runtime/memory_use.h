// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace stillmap {

/// This process's resident memory now, and the most it ever had, in KB, as the kernel counts it; 0 where
/// /proc is not mounted.
std::uint64_t resident_kb();
std::uint64_t resident_peak_kb();
/// How often this process has waited for a page from the disk.
std::uint64_t major_faults();

}  // namespace stillmap
