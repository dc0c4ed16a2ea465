// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>

#include "core/time.h"

namespace stillmap {

/// A histogram of times in fixed memory, exact to 1.6 % over the whole range from 1 us to an hour. One thread
/// adds; it is read when that thread has ended.
class LatencyHistogram {
 public:
  void add(Nanoseconds time) {
    const auto us = static_cast<std::uint64_t>(std::max<Nanoseconds>(time, 0) / 1000);
    ++counts_[std::min(bucket_of(us), counts_.size() - 1)];
    ++count_;
    max_ns_ = std::max(max_ns_, time);
  }
  std::uint64_t count() const { return count_; }
  double max_ms() const { return to_ms(max_ns_); }
  /// The least time that a share (0 to 1) of all is not above; 0 without any.
  double quantile_ms(double share) const {
    // 0.95 of 20 is 19, whatever the rounding of 0.95 makes of it.
    const double rank = std::max(1.0, std::ceil(share * static_cast<double>(count_) - 1e-6));
    std::uint64_t seen = 0;
    for (std::size_t b = 0; b < counts_.size(); ++b) {
      seen += counts_[b];
      if (static_cast<double>(seen) >= rank) return std::min(upper_us(b) / 1000, max_ms());
    }
    return max_ms();
  }

 private:
  // 64 buckets for every doubling: the top six bits after the leading one.
  static constexpr std::uint64_t kPerOctave = 64;
  static std::size_t bucket_of(std::uint64_t us) {
    if (us < kPerOctave) return static_cast<std::size_t>(us);
    const auto shift = static_cast<std::uint64_t>(std::bit_width(us)) - 7;
    return static_cast<std::size_t>(shift * kPerOctave + (us >> shift));
  }
  static double upper_us(std::size_t bucket) {
    if (bucket < 2 * kPerOctave) return static_cast<double>(bucket + 1);
    const std::uint64_t shift = bucket / kPerOctave - 1;
    return static_cast<double>((bucket - shift * kPerOctave + 1) << shift);
  }

  std::array<std::uint32_t, kPerOctave * 28> counts_{};
  std::uint64_t count_ = 0;
  Nanoseconds max_ns_ = 0;
};

}  // namespace stillmap
