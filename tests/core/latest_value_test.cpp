// SPDX-License-Identifier: Apache-2.0
#include "core/latest_value.h"

#include <gtest/gtest.h>

#include <array>
#include <memory>
#include <thread>

namespace stillmap {
namespace {

using Number = std::unique_ptr<int>;  // owns, so that a value lost or given out twice shows
Number number(int v) {
  return std::make_unique<int>(v);
}

TEST(LatestValue, NothingBeforeTheFirst) {
  LatestValue<Number> latest;
  EXPECT_FALSE(latest.refresh());
  EXPECT_EQ(latest.generation(), 0u);
  EXPECT_EQ(latest.value(), nullptr);
}

TEST(LatestValue, TheReaderGetsTheNewestOnce) {
  LatestValue<Number> latest;
  EXPECT_EQ(latest.publish(number(1)), nullptr);
  EXPECT_TRUE(latest.refresh());
  EXPECT_EQ(*latest.value(), 1);
  EXPECT_FALSE(latest.refresh()) << "nothing newer";
  EXPECT_EQ(*latest.value(), 1) << "and the old one stays";
  EXPECT_EQ(latest.publish(number(2)), nullptr) << "the reader has taken 1: nothing is displaced";
  EXPECT_EQ(*latest.value(), 1) << "until it asks";
  EXPECT_TRUE(latest.refresh());
  EXPECT_EQ(*latest.value(), 2);
  EXPECT_EQ(latest.generation(), 2u);
  EXPECT_EQ(latest.displaced(), 0u);
}

TEST(LatestValue, TheWriterGetsBackWhatNobodyRead) {
  LatestValue<Number> latest;
  EXPECT_EQ(latest.publish(number(1)), nullptr);
  EXPECT_EQ(*latest.publish(number(2)), 1);
  EXPECT_EQ(*latest.publish(number(3)), 2);
  EXPECT_EQ(latest.displaced(), 2u);
  EXPECT_TRUE(latest.refresh());
  EXPECT_EQ(*latest.value(), 3);
  EXPECT_EQ(latest.publish(number(4)), nullptr);
  EXPECT_EQ(latest.displaced(), 2u);
}

TEST(LatestValue, ARefreshClearsTheOlderValue) {
  LatestValue<std::shared_ptr<int>> latest;
  const auto first = std::make_shared<int>(1);
  (void)latest.publish(first);
  EXPECT_TRUE(latest.refresh());
  (void)latest.publish(std::make_shared<int>(2));
  EXPECT_EQ(first.use_count(), 2);
  EXPECT_TRUE(latest.refresh());
  EXPECT_EQ(first.use_count(), 1) << "a frame would otherwise be held for nothing";
}

TEST(LatestValue, BetweenThreadsEveryValueIsReadOrGivenBackOnce) {
  constexpr int kCount = 200'000;
  struct Wide {  // torn copies would differ inside
    std::array<int, 16> copies{};
    std::shared_ptr<int> owner;
  };
  LatestValue<Wide> latest;
  std::atomic<bool> done{false};
  int read = 0, last = 0, torn = 0, backwards = 0;
  std::thread reader([&] {
    while (true) {
      const bool last_look = done.load(std::memory_order_acquire);
      if (latest.refresh()) {
        const Wide& v = latest.value();
        ++read;
        backwards += v.copies[0] <= last ? 1 : 0;
        last = v.copies[0];
        for (int c : v.copies) torn += c != last ? 1 : 0;
        torn += v.owner == nullptr || *v.owner != last ? 1 : 0;
      } else if (last_look) {
        return;
      }
    }
  });
  int given_back = 0, given_back_wrong = 0, last_back = 0;
  for (int i = 1; i <= kCount; ++i) {
    Wide w;
    w.copies.fill(i);
    w.owner = std::make_shared<int>(i);
    const Wide back = latest.publish(std::move(w));
    if (back.owner == nullptr) continue;
    ++given_back;
    given_back_wrong += back.copies[0] != i - 1 || back.copies[0] <= last_back ? 1 : 0;
    last_back = back.copies[0];
  }
  done.store(true, std::memory_order_release);
  reader.join();
  EXPECT_EQ(read + given_back, kCount);
  EXPECT_EQ(latest.displaced(), static_cast<std::uint64_t>(given_back));
  EXPECT_EQ(latest.generation(), static_cast<std::uint64_t>(read));
  EXPECT_EQ(last, kCount) << "the newest always arrives";
  EXPECT_EQ(torn, 0);
  EXPECT_EQ(backwards, 0);
  EXPECT_EQ(given_back_wrong, 0);
}

}  // namespace
}  // namespace stillmap
