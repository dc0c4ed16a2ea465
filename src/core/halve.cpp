// SPDX-License-Identifier: Apache-2.0
#include "core/halve.h"

#include <algorithm>
#include <array>
#include <cstdint>

#include "core/vector_clones.h"

namespace stillmap {

namespace {

constexpr std::size_t kAtOnce = 64;  // pixels of the output

/// Bytes as the mean of themselves and of those one pixel on, in both rows: those of every other pixel are
/// wanted, and making all of them is the form that a compiler does many at once.
STILLMAP_VECTOR_CLONES void mean_with_next(const std::uint8_t* upper, const std::uint8_t* lower,
                                           std::size_t count, std::uint8_t* mean) {
  for (std::size_t i = 0; i < count; ++i)
    mean[i] = static_cast<std::uint8_t>((upper[i] + upper[i + 3] + lower[i] + lower[i + 3] + 2) >> 2);
}

}  // namespace

void halve_row(const Bgr* upper, const Bgr* lower, std::span<Bgr> out) {
  static_assert(sizeof(Bgr) == 3);
  std::array<std::uint8_t, 6 * kAtOnce> mean;
  for (std::size_t first = 0; first < out.size(); first += kAtOnce) {
    const std::size_t count = std::min(kAtOnce, out.size() - first);
    mean_with_next(reinterpret_cast<const std::uint8_t*>(upper + 2 * first),
                   reinterpret_cast<const std::uint8_t*>(lower + 2 * first), 6 * count - 3, mean.data());
    for (std::size_t x = 0; x < count; ++x) out[first + x] = {mean[6 * x], mean[6 * x + 1], mean[6 * x + 2]};
  }
}

}  // namespace stillmap
