// SPDX-License-Identifier: Apache-2.0
#include "drivers/arrivals.h"

#include <gtest/gtest.h>

#include <thread>

#include "tests/support/heap_calls.h"

namespace stillmap {
namespace {

constexpr Nanoseconds kLong = 20'000'000'000;

TEST(Arrivals, NothingArrivesBeforeTheDeadlineAndAWakeEndsTheWait) {
  Arrivals arrivals;
  EXPECT_FALSE(arrivals.wait(monotonic_now()));
  arrivals.wake();
  EXPECT_TRUE(arrivals.wait(monotonic_now() + kLong));
  EXPECT_FALSE(arrivals.arrived().has_value());
  EXPECT_FALSE(arrivals.wait(monotonic_now())) << "one wake ends one wait";
}

TEST(Arrivals, BuffersGoToAndFroInTheirOrderWithoutTheHeap) {
  constexpr std::size_t kBuffers = 4, kPictures = 5000;
  Arrivals arrivals;
  for (std::size_t i = 0; i < kBuffers; ++i) arrivals.release(i);
  std::thread library([&] {
    for (std::size_t sent = 0; sent < kPictures;) {
      const auto buffer = arrivals.released();
      if (!buffer) {
        std::this_thread::yield();
        continue;
      }
      EXPECT_EQ(*buffer, sent % kBuffers);
      arrivals.arrive(*buffer);
      ++sent;
    }
  });
  const long heap_before = test::heap_calls();
  std::size_t got = 0;
  while (got < kPictures) {
    if (const auto buffer = arrivals.arrived()) {
      EXPECT_EQ(*buffer, got++ % kBuffers);
      arrivals.release(*buffer);
    } else if (!arrivals.wait(monotonic_now() + kLong)) {
      break;
    }
  }
  EXPECT_EQ(test::heap_calls(), heap_before);
  EXPECT_EQ(got, kPictures);
  library.join();
}

TEST(Arrivals, ClearForgetsBoth) {
  Arrivals arrivals;
  arrivals.arrive(1);
  arrivals.release(2);
  arrivals.clear();
  EXPECT_FALSE(arrivals.arrived().has_value());
  EXPECT_FALSE(arrivals.released().has_value());
}

}  // namespace
}  // namespace stillmap
