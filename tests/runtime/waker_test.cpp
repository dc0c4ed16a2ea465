// SPDX-License-Identifier: Apache-2.0
#include "runtime/waker.h"

#include <gtest/gtest.h>

#include <thread>

namespace stillmap {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000, kSecond = 1'000'000'000;

TEST(Waker, ReturnsAfterTheTimeOut) {
  Waker waker;
  const Nanoseconds begin = monotonic_now();
  // A signal may end the wait early; a few in a row are never all ended so.
  for (int i = 0; i < 3; ++i) waker.wait(waker.ticket(), 10 * kMillisecond);
  EXPECT_GE(monotonic_now() - begin, 20 * kMillisecond);
  waker.wait(waker.ticket(), 0);
  waker.wait(waker.ticket(), -kSecond);
  EXPECT_LT(monotonic_now() - begin, 10 * kSecond);
}

TEST(Waker, AWakeBetweenTicketAndWaitIsNotLost) {
  Waker waker;
  const std::uint32_t ticket = waker.ticket();
  waker.wake();
  const Nanoseconds begin = monotonic_now();
  waker.wait(ticket, 30 * kSecond);
  EXPECT_LT(monotonic_now() - begin, 10 * kSecond);
}

TEST(Waker, EndsAWaitThatHasBegun) {
  Waker waker;
  const std::uint32_t ticket = waker.ticket();
  std::thread other([&] {
    Waker never;
    never.wait(never.ticket(), 50 * kMillisecond);
    waker.wake();
  });
  const Nanoseconds begin = monotonic_now();
  waker.wait(ticket, 30 * kSecond);
  EXPECT_LT(monotonic_now() - begin, 10 * kSecond);
  other.join();
}

TEST(Waker, WakesEverySleeper) {
  Waker waker;
  const std::uint32_t ticket = waker.ticket();
  const Nanoseconds begin = monotonic_now();
  std::thread a([&] { waker.wait(ticket, 30 * kSecond); }), b([&] { waker.wait(ticket, 30 * kSecond); });
  waker.wake();
  a.join();
  b.join();
  EXPECT_LT(monotonic_now() - begin, 10 * kSecond);
}

/// Two threads hand a number to and fro: a lost wake ends by the time-out only, and what one wrote before
/// waking the other reads.
TEST(Waker, LosesNoneBetweenTwoThreads) {
  Waker to_a, to_b;
  std::atomic<int> turn{0};
  int handed = 0;  // no atomic: the wakers and `turn` order it
  std::atomic<int> timed_out{0};
  constexpr int kRounds = 5'000;
  const auto play = [&](int parity, Waker& mine, Waker& theirs) {
    for (int round = parity; round < kRounds; round += 2) {
      for (;;) {
        const std::uint32_t ticket = mine.ticket();
        if (turn.load(std::memory_order_acquire) == round) break;
        const Nanoseconds begin = monotonic_now();
        mine.wait(ticket, 20 * kSecond);
        timed_out += monotonic_now() - begin >= 20 * kSecond;
      }
      ASSERT_EQ(handed, round);
      ++handed;
      turn.store(round + 1, std::memory_order_release);
      theirs.wake();
    }
  };
  std::thread a([&] { play(0, to_a, to_b); }), b([&] { play(1, to_b, to_a); });
  a.join();
  b.join();
  EXPECT_EQ(handed, kRounds);
  EXPECT_EQ(timed_out.load(), 0);
}

}  // namespace
}  // namespace stillmap
