// SPDX-License-Identifier: Apache-2.0
#include "core/frame_pool.h"

#include <gtest/gtest.h>

#include <memory>
#include <set>
#include <thread>
#include <vector>

#include "core/spsc_ring.h"

namespace stillmap {
namespace {

constexpr std::size_t kFrames = 4;
constexpr int kWidth = 8, kHeight = 3;

class Pool : public testing::Test {
 protected:
  Pool() {
    Arena plan;
    FramePool planned(plan, kFrames, kWidth, kHeight);
    arena_ = std::make_unique<Arena>(plan.bytes_planned());
    pool_ = std::make_unique<FramePool>(*arena_, kFrames, kWidth, kHeight);
  }
  std::unique_ptr<Arena> arena_;
  std::unique_ptr<FramePool> pool_;
};

TEST_F(Pool, FramesDoNotOverlap) {
  std::vector<FrameHandle> held;
  for (std::size_t i = 0; i < kFrames; ++i) {
    held.push_back(pool_->acquire());
    FrameSlot& slot = held.back().writable();
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const auto v = static_cast<std::uint8_t>(i + 1);
        slot.colour.at(x, y) = {v, v, v};
        slot.depth.at(x, y) = v;
      }
    }
  }
  for (std::size_t i = 0; i < kFrames; ++i) {
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        ASSERT_EQ(held[i]->colour.at(x, y).r, i + 1);
        ASSERT_EQ(held[i]->depth.at(x, y), i + 1);
      }
    }
  }
}

TEST_F(Pool, ExhaustionIsCountedAndPasses) {
  std::vector<FrameHandle> held;
  for (std::size_t i = 0; i < kFrames; ++i) held.push_back(pool_->acquire());
  EXPECT_FALSE(pool_->acquire());
  EXPECT_FALSE(pool_->acquire());
  held[2].reset();
  FrameHandle again = pool_->acquire();
  EXPECT_TRUE(again);
  EXPECT_FALSE(pool_->acquire());
  const PoolUsage usage = pool_->usage();
  EXPECT_EQ(usage.capacity, kFrames);
  EXPECT_EQ(usage.high_water, kFrames);
  EXPECT_EQ(usage.refused, 3u);
}

TEST_F(Pool, HighWaterIsTheMostHeldAtOnce) {
  for (int i = 0; i < 20; ++i) {
    FrameHandle a = pool_->acquire();
    FrameHandle b = pool_->acquire();
  }
  EXPECT_EQ(pool_->usage().high_water, 2u);
  EXPECT_EQ(pool_->usage().refused, 0u);
}

TEST_F(Pool, AFrameReturnsWithItsLastHolder) {
  std::vector<FrameHandle> rest;
  FrameHandle first = pool_->acquire();
  for (std::size_t i = 1; i < kFrames; ++i) rest.push_back(pool_->acquire());
  const FrameSlot* slot = &*first;
  FrameHandle second = first.share();
  EXPECT_EQ(&*second, slot);
  first.reset();
  first.reset();  // twice is as once
  EXPECT_FALSE(first);
  EXPECT_FALSE(pool_->acquire()) << "still shared";
  FrameHandle third = std::move(second);
  EXPECT_FALSE(second);  // NOLINT(bugprone-use-after-move): moved-from handles are empty by contract
  EXPECT_FALSE(pool_->acquire()) << "a move changes no count";
  third = FrameHandle();
  FrameHandle again = pool_->acquire();
  ASSERT_TRUE(again);
  EXPECT_EQ(&*again, slot);
}

TEST_F(Pool, AssigningOverAHandleReleasesItsFrame) {
  FrameHandle a = pool_->acquire(), b = pool_->acquire();
  const FrameSlot* slot = &*b;
  a = std::move(b);
  EXPECT_EQ(&*a, slot);
  FrameHandle& same = a;
  a = std::move(same);
  EXPECT_EQ(&*a, slot) << "self-assignment keeps the frame";
  a.reset();
  std::vector<FrameHandle> all;
  for (std::size_t i = 0; i < kFrames; ++i) all.push_back(pool_->acquire());
  EXPECT_TRUE(all.back()) << "none leaked";
}

using PoolDeathTest = Pool;

TEST_F(PoolDeathTest, WritingASharedFrameIsABug) {
  FrameHandle a = pool_->acquire();
  FrameHandle b = a.share();
  EXPECT_DEATH(a.writable(), "bug:");
}

TEST_F(PoolDeathTest, UsingAnEmptyHandleIsABug) {
  FrameHandle none;
  EXPECT_DEATH((void)*none, "bug:");
  EXPECT_DEATH((void)none.share(), "bug:");
}

TEST_F(PoolDeathTest, AFrameThatOutlivesItsPoolIsABug) {
  EXPECT_DEATH(
      {
        FrameHandle held = pool_->acquire();
        pool_.reset();
      },
      "bug:");
}

TEST_F(Pool, ThreadsSeeWholeFramesAndLoseNone) {
  // Capture writes a pattern and hands each frame to two consumers; whoever lets go last returns it.
  constexpr std::uint64_t kCount = 5'000;
  SpscRing<FrameHandle, 2> to_tracker, to_map;
  const auto consume = [](SpscRing<FrameHandle, 2>& ring, std::uint64_t& good) {
    for (std::uint64_t wanted = 0; wanted < kCount;) {
      const std::optional<FrameHandle> frame = ring.try_pop();
      if (!frame) {
        std::this_thread::yield();
        continue;
      }
      const FrameSlot& slot = **frame;
      const auto mark = static_cast<std::uint16_t>(wanted);
      good += slot.sequence == wanted && slot.depth.at(0, 0) == mark &&
              slot.depth.at(kWidth - 1, kHeight - 1) == mark;
      ++wanted;
    }
  };
  std::uint64_t good_tracker = 0, good_map = 0;
  std::thread tracker(consume, std::ref(to_tracker), std::ref(good_tracker));
  std::thread map(consume, std::ref(to_map), std::ref(good_map));
  for (std::uint64_t i = 0; i < kCount;) {
    FrameHandle frame = pool_->acquire();
    if (!frame) {
      std::this_thread::yield();
      continue;
    }
    FrameSlot& slot = frame.writable();
    slot.sequence = i;
    slot.depth.at(0, 0) = slot.depth.at(kWidth - 1, kHeight - 1) = static_cast<std::uint16_t>(i);
    FrameHandle shared = frame.share();
    while (!to_tracker.try_push(std::move(frame))) std::this_thread::yield();
    while (!to_map.try_push(std::move(shared))) std::this_thread::yield();
    ++i;
  }
  tracker.join();
  map.join();
  EXPECT_EQ(good_tracker, kCount);
  EXPECT_EQ(good_map, kCount);
  std::vector<FrameHandle> all;
  for (std::size_t i = 0; i < kFrames; ++i) all.push_back(pool_->acquire());
  EXPECT_TRUE(all.back()) << "every frame came back";
}

}  // namespace
}  // namespace stillmap
