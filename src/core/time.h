// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>

namespace stillmap {

/// Time in nanoseconds. Frame stamps are on the source's clock (a log's own stamps, a camera's monotonic
/// kernel stamps); latencies are on the monotonic clock.
using Nanoseconds = std::int64_t;

inline Nanoseconds monotonic_now() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}
constexpr double to_seconds(Nanoseconds t) {
  return static_cast<double>(t) * 1e-9;
}
constexpr double to_ms(Nanoseconds t) {
  return static_cast<double>(t) * 1e-6;
}

}  // namespace stillmap
