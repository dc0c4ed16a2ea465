// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace stillmap {

/// SplitMix64 (Steele, Lea and Flood, OOPSLA 2014): small, seedable, the same on every platform and library.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  /// The n-th of the sequences that a run with this seed (runtime.seed) draws from.
  static Random of(std::int64_t seed, std::uint64_t n) {
    return Random(static_cast<std::uint64_t>(seed) * 0x9e3779b97f4a7c15ULL + n);
  }
  std::uint64_t next() {
    std::uint64_t z = state_ += 0x9e3779b97f4a7c15ULL;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ z >> 27) * 0x94d049bb133111ebULL;
    return z ^ z >> 31;
  }
  /// In [0, 1).
  double uniform() { return static_cast<double>(next() >> 11) * 0x1p-53; }
  /// In [0, bound), bound > 0.
  std::uint32_t below(std::uint32_t bound) {
    return static_cast<std::uint32_t>((next() >> 32) * bound >> 32);
  }

 private:
  std::uint64_t state_;
};

}  // namespace stillmap
