// SPDX-License-Identifier: Apache-2.0
#include "stream/cloud_exchange.h"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

namespace stillmap::stream {
namespace {

TEST(CloudExchange, GoesAroundAndCounts) {
  std::vector<CloudPoint> memory(4);
  CloudExchange cloud(memory);
  EXPECT_TRUE(cloud.readable());
  EXPECT_EQ(cloud.generation(), 0U);
  EXPECT_FALSE(cloud.wanted());
  EXPECT_TRUE(cloud.begin().empty());  // not offered
  cloud.offer();
  EXPECT_TRUE(cloud.wanted());
  EXPECT_FALSE(cloud.readable());
  ASSERT_EQ(cloud.begin().size(), 4U);
  EXPECT_FALSE(cloud.wanted());
  cloud.offer();
  cloud.reclaim();  // too late for both
  EXPECT_FALSE(cloud.readable());
  cloud.publish(3, 99, 4);
  EXPECT_TRUE(cloud.readable());
  EXPECT_EQ(cloud.points().size(), 3U);
  EXPECT_EQ(cloud.stamp_ns(), 99);
  EXPECT_EQ(cloud.epoch(), 4U);
  EXPECT_EQ(cloud.generation(), 1U);
}

TEST(CloudExchange, AnOfferCanBeTakenBackAndTheOldCloudIsStillThere) {
  std::vector<CloudPoint> memory(4);
  CloudExchange cloud(memory);
  cloud.offer();
  cloud.begin()[0].x = 5;
  cloud.publish(1, 1, 0);
  cloud.offer();
  cloud.reclaim();
  EXPECT_TRUE(cloud.readable());
  EXPECT_TRUE(cloud.begin().empty());
  EXPECT_EQ(cloud.points()[0].x, 5.0F);
  EXPECT_EQ(cloud.generation(), 1U);
}

TEST(CloudExchange, WithoutMemoryNothingIsEverFilled) {
  CloudExchange cloud({});
  cloud.offer();
  EXPECT_TRUE(cloud.begin().empty());
}

TEST(CloudExchangeDeathTest, PublishingWhatWasNotBegunIsABug) {
  std::vector<CloudPoint> memory(4);
  CloudExchange cloud(memory);
  EXPECT_DEATH(cloud.publish(1, 1, 0), "bug");
  cloud.offer();
  cloud.begin();
  EXPECT_DEATH(cloud.publish(5, 1, 0), "bug");
}

TEST(CloudExchange, TwoThreadsNeverTouchTheBufferAtOnce) {
  constexpr int kClouds = 2000;
  std::vector<CloudPoint> memory(64);
  CloudExchange cloud(memory);
  std::thread map([&] {
    for (int n = 1; n <= kClouds;) {
      const std::span<CloudPoint> points = cloud.begin();
      if (points.empty()) {
        std::this_thread::yield();
        continue;
      }
      for (CloudPoint& point : points) point.x = static_cast<float>(n);
      cloud.publish(points.size() - static_cast<std::size_t>(n % 8), n, 0);
      ++n;
    }
  });
  for (std::uint64_t round = 0; cloud.generation() < kClouds; ++round) {
    if (!cloud.readable()) {
      if (round % 3 == 0) cloud.reclaim();
      std::this_thread::yield();
      continue;
    }
    ASSERT_EQ(cloud.stamp_ns(), static_cast<Nanoseconds>(cloud.generation()));
    for (const CloudPoint& point : cloud.points()) ASSERT_EQ(point.x, static_cast<float>(cloud.stamp_ns()));
    cloud.offer();
  }
  map.join();
}

}  // namespace
}  // namespace stillmap::stream
