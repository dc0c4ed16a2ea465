// SPDX-License-Identifier: Apache-2.0
#include "runtime/latency.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/random.h"

namespace stillmap {
namespace {

constexpr Nanoseconds kMicrosecond = 1000, kHour = 3'600'000'000'000;

TEST(LatencyHistogram, IsZeroWithoutAny) {
  const LatencyHistogram h;
  EXPECT_EQ(h.count(), 0u);
  EXPECT_EQ(h.quantile_ms(0.5), 0);
  EXPECT_EQ(h.max_ms(), 0);
}

TEST(LatencyHistogram, IsExactTo1Point6PercentFromAMicrosecondToAnHour) {
  for (Nanoseconds time = kMicrosecond; time <= kHour;
       time += std::max<Nanoseconds>(kMicrosecond, time / 777)) {
    LatencyHistogram h;
    h.add(time);
    h.add(2 * kHour);  // so that the maximum does not bound the answer
    const double found = h.quantile_ms(0.5);
    ASSERT_GE(found, to_ms(time) - 1e-9) << time;
    ASSERT_LE(found, to_ms(time) * (1 + 1 / 64.0) + 0.001) << time;
  }
}

TEST(LatencyHistogram, QuantilesAreNearestRanks) {
  LatencyHistogram h;
  std::vector<Nanoseconds> times;
  Random random(7);
  for (int i = 0; i < 1000; ++i)
    times.push_back(static_cast<Nanoseconds>(std::exp(random.uniform() * 12) * 1000));
  for (const Nanoseconds time : times) h.add(time);
  std::sort(times.begin(), times.end());
  for (const double share : {0.001, 0.05, 0.5, 0.95, 0.99, 0.999}) {
    const double exact = to_ms(times[static_cast<std::size_t>(std::lround(share * 1000)) - 1]);
    EXPECT_GE(h.quantile_ms(share), exact - 1e-9) << share;
    EXPECT_LE(h.quantile_ms(share), exact * (1 + 1 / 64.0) + 0.001) << share;
  }
  EXPECT_EQ(h.quantile_ms(1), to_ms(times.back()));
  EXPECT_EQ(h.max_ms(), to_ms(times.back()));
}

TEST(LatencyHistogram, OneInAHundredIsNotTheP99) {
  LatencyHistogram h;
  for (int i = 0; i < 99; ++i) h.add(10 * kMicrosecond);
  h.add(kHour);
  EXPECT_LT(h.quantile_ms(0.99), 1);
  EXPECT_EQ(h.max_ms(), to_ms(kHour));
}

TEST(LatencyHistogram, TakesExtremes) {
  LatencyHistogram h;
  h.add(-5);
  h.add(0);
  EXPECT_EQ(h.quantile_ms(1), 0);
  h.add(std::numeric_limits<Nanoseconds>::max());
  EXPECT_EQ(h.count(), 3u);
  EXPECT_GT(h.quantile_ms(1), to_ms(2 * kHour));
  EXPECT_LE(h.quantile_ms(0.5), 0.001);
}

}  // namespace
}  // namespace stillmap
