// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace stillmap::synthetic {

/// A good 64-bit mix (the finaliser of SplitMix64): the only source of chance here, so that a seed means the
/// same bytes with every standard library.
constexpr std::uint64_t mix(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

class Random {
 public:
  explicit Random(std::uint64_t seed, std::uint64_t purpose = 0) : state_(mix(seed) ^ mix(~purpose)) {}

  std::uint64_t bits() {
    state_ += 0x9e3779b97f4a7c15ULL;
    return mix(state_);
  }
  /// In [0, n).
  int below(int n) { return static_cast<int>(bits() % static_cast<std::uint64_t>(n)); }
  double uniform(double from, double to) {
    return from + (to - from) * static_cast<double>(bits() >> 11) * 0x1p-53;
  }
  bool chance(double share) { return uniform(0, 1) < share; }
  int sign() { return below(2) == 0 ? -1 : 1; }
  /// Mean 0, sigma 1: the sum of four uniforms is near enough to a Gaussian for a sensor, and costs one draw.
  float gaussian() {
    const std::uint64_t b = bits();
    const auto sum =
        static_cast<float>((b & 0xffff) + ((b >> 16) & 0xffff) + ((b >> 32) & 0xffff) + (b >> 48));
    return (sum - 131070.0f) * (1.7320508f / 65536.0f);
  }

 private:
  std::uint64_t state_;
};

}  // namespace stillmap::synthetic
