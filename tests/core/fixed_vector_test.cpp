// SPDX-License-Identifier: Apache-2.0
#include "core/fixed_vector.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>

namespace stillmap {
namespace {

using testing::ElementsAre;

std::span<const int> items(std::span<const int> v) {
  return v;
}

TEST(FixedVector, RefusesWhatDoesNotFit) {
  FixedVector<int, 3> v;
  EXPECT_TRUE(v.empty());
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(v.try_push_back(i));
  EXPECT_FALSE(v.try_push_back(9));
  EXPECT_THAT(items(v), ElementsAre(0, 1, 2));
  v.truncate(5);
  EXPECT_EQ(v.size(), 3u);
  v.truncate(1);
  EXPECT_THAT(items(v), ElementsAre(0));
  EXPECT_TRUE(v.try_push_back(7));
  EXPECT_THAT(items(v), ElementsAre(0, 7));
  v.clear();
  EXPECT_TRUE(v.empty());
  static_assert(std::is_trivially_copyable_v<FixedVector<int, 3>>, "it crosses threads by memcpy");
}

TEST(ArenaVector, CountsHighWaterAndRefusals) {
  std::array<int, 3> memory{};
  ArenaVector<int> v{memory};
  for (int i = 0; i < 5; ++i) EXPECT_EQ(v.try_push_back(i), i < 3);
  EXPECT_TRUE(v.full());
  v.pop_back();
  v.resize_down(9);
  EXPECT_THAT(items(v), ElementsAre(0, 1));
  v.resize_down(1);
  EXPECT_THAT(items(v), ElementsAre(0));
  v.clear();
  const PoolUsage usage = v.usage("points");
  EXPECT_STREQ(usage.name, "points");
  EXPECT_EQ(usage.capacity, 3u);
  EXPECT_EQ(usage.high_water, 3u) << "kept over clear()";
  EXPECT_EQ(usage.refused, 2u);
}

TEST(ArenaVector, WithoutMemoryHoldsNothing) {
  ArenaVector<int> v;
  EXPECT_TRUE(v.full());
  EXPECT_FALSE(v.try_push_back(1));
}

TEST(ArenaVectorDeathTest, PoppingFromAnEmptyOneIsABug) {
  ArenaVector<int> v;
  EXPECT_DEATH(v.pop_back(), "bug: size_ > 0");
}

}  // namespace
}  // namespace stillmap
