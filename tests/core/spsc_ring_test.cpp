// SPDX-License-Identifier: Apache-2.0
#include "core/spsc_ring.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <thread>

namespace stillmap {
namespace {

using Number = std::unique_ptr<int>;

TEST(SpscRing, KeepsOrderOverManyTurns) {
  SpscRing<int, 4> ring;
  int pushed = 0, popped = 0;
  for (int round = 0; round < 100; ++round) {
    for (int i = 0; i < 3; ++i) ASSERT_TRUE(ring.try_push(pushed++));
    for (int i = 0; i < 3; ++i) ASSERT_EQ(ring.try_pop(), popped++);
  }
  EXPECT_EQ(ring.try_pop(), std::nullopt);
  EXPECT_EQ(ring.usage("r").high_water, 3u);
  EXPECT_EQ(ring.usage("r").refused, 0u);
}

TEST(SpscRing, AFullOneRefusesAndLeavesTheItem) {
  SpscRing<Number, 2> ring;
  ASSERT_TRUE(ring.try_push(std::make_unique<int>(1)));
  ASSERT_TRUE(ring.try_push(std::make_unique<int>(2)));
  Number third = std::make_unique<int>(3);
  EXPECT_FALSE(ring.try_push(std::move(third)));
  ASSERT_NE(third, nullptr);  // NOLINT(bugprone-use-after-move): a refused item stays with the caller
  EXPECT_EQ(ring.size(), 2u);
  EXPECT_EQ(**ring.try_pop(), 1);
  EXPECT_TRUE(ring.try_push(std::move(third)));
  EXPECT_EQ(**ring.try_pop(), 2);
  EXPECT_EQ(**ring.try_pop(), 3);
  const PoolUsage usage = ring.usage("r");
  EXPECT_STREQ(usage.name, "r");
  EXPECT_EQ(usage.capacity, 2u);
  EXPECT_EQ(usage.high_water, 2u);
  EXPECT_EQ(usage.refused, 1u);
}

/// The indices wrap after three turns of the ring: the head does so before the tail, at each fill level.
TEST(SpscRing, IndicesWrapUnnoticedAtEveryFillLevel) {
  for (std::size_t level = 1; level <= 4; ++level) {
    SpscRing<int, 4> ring;
    int pushed = 0, popped = 0;
    while (ring.size() < level) ASSERT_TRUE(ring.try_push(pushed++));
    for (int step = 0; step < 20; ++step) {
      if (level == 4) {
        ASSERT_FALSE(ring.try_push(-1)) << "step " << step;
      }
      ASSERT_EQ(ring.try_pop(), popped++) << "level " << level;
      ASSERT_EQ(ring.size(), level - 1);
      ASSERT_TRUE(ring.try_push(pushed++)) << "level " << level << ", step " << step;
      ASSERT_EQ(ring.size(), level);
    }
    while (ring.size() > 0) ASSERT_EQ(ring.try_pop(), popped++);
    EXPECT_EQ(ring.try_pop(), std::nullopt);
    EXPECT_EQ(ring.usage("r").high_water, level);
  }
}

TEST(SpscRing, APoppedSlotHoldsNothing) {
  SpscRing<std::shared_ptr<int>, 4> ring;
  const auto item = std::make_shared<int>(1);
  ASSERT_TRUE(ring.try_push(std::shared_ptr<int>(item)));
  EXPECT_EQ(item.use_count(), 2);
  (void)ring.try_pop();
  EXPECT_EQ(item.use_count(), 1) << "a frame would otherwise be held until the slot is used again";
}

TEST(SpscRing, BetweenThreadsNothingIsLostDoubledOrSwapped) {
  constexpr int kCount = 50'000;
  SpscRing<Number, 8> ring;
  std::atomic<bool> done{false};
  std::size_t largest = 0;
  std::thread watcher([&] {
    while (!done.load()) {
      for (int look = 0; look < 1000; ++look) largest = std::max(largest, ring.size());
      std::this_thread::yield();
    }
  });
  int wrong = 0;
  std::thread consumer([&] {
    for (int wanted = 0; wanted < kCount;) {
      const std::optional<Number> item = ring.try_pop();
      if (!item) {
        std::this_thread::yield();
        continue;
      }
      wrong += *item == nullptr || **item != wanted ? 1 : 0;
      ++wanted;
    }
  });
  std::uint64_t refused = 0;
  for (int i = 0; i < kCount;) {
    Number item = std::make_unique<int>(i);
    while (!ring.try_push(std::move(item))) {
      ++refused;
      std::this_thread::yield();
    }
    ++i;
  }
  consumer.join();
  done.store(true);
  watcher.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(ring.try_pop(), std::nullopt);
  EXPECT_EQ(ring.usage("r").refused, refused);
  EXPECT_LE(ring.usage("r").high_water, 8u);
  EXPECT_LE(largest, 8u) << "size() seen from a third thread stays within the ring";
}

}  // namespace
}  // namespace stillmap
