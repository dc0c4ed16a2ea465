// SPDX-License-Identifier: Apache-2.0
#include "runtime/load_shedder.h"

#include <gtest/gtest.h>

namespace stillmap {
namespace {

constexpr Nanoseconds kPeriod = 33'000'000, kInTime = kPeriod / 2, kJustInTime = kPeriod * 9 / 10,
                      kLate = 2 * kPeriod;
constexpr int kLast = static_cast<int>(kSheddingPlan.size()) - 1;

struct Bench {
  Bench() { run(30, kLate); }  // the warm-up, in which nothing counts
  /// So many frames; how often the step changed.
  int run(int frames, Nanoseconds latency, bool lost = false) {
    int changes = 0;
    for (int i = 0; i < frames; ++i) changes += shedder.note(latency, lost) != LoadShedder::Change::None;
    return changes;
  }
  /// Frames in time until a step is taken back.
  int frames_to_raise() {
    const int before = shedder.step();
    for (int frames = 1; frames < 10'000; ++frames) {
      shedder.note(kInTime, false);
      if (shedder.step() < before) return frames;
    }
    return -1;
  }
  LoadShedder shedder{kPeriod};
};

TEST(SheddingPlan, GivesUpDetectorThenFeaturesThenFusion) {
  const auto part_of = [](const Quality& q) {
    return q.fuse_factor > 1 ? 3 : q.feature_share < 1 ? 2 : q.detector_every > 1 ? 1 : 0;
  };
  for (std::size_t i = 1; i < kSheddingPlan.size(); ++i) {
    const Quality &before = kSheddingPlan[i - 1], &now = kSheddingPlan[i];
    EXPECT_GE(part_of(now), part_of(before));
    const int changed = (now.detector_every > before.detector_every) +
                        (now.feature_share < before.feature_share) + (now.fuse_factor > before.fuse_factor);
    EXPECT_EQ(changed, 1) << now.name;
  }
  EXPECT_EQ(part_of(kSheddingPlan[0]), 0);
  EXPECT_EQ(part_of(kSheddingPlan[kLast]), 3);
}

TEST(LoadShedder, TheFirstSecondDoesNotCount) {
  EXPECT_EQ(Bench().shedder.step(), 0);
}

TEST(LoadShedder, AHiccupChangesNothing) {
  Bench bench;
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(bench.run(3, kLate), 0);  // a fifth of the window
    EXPECT_EQ(bench.run(12, kInTime), 0);
  }
}

TEST(LoadShedder, LateFramesTakeOneStepAfterTheOther) {
  Bench bench;
  for (int step = 1; step <= kLast; ++step) {
    EXPECT_EQ(bench.run(3, kLate), 0);
    EXPECT_EQ(bench.shedder.note(kLate, false), LoadShedder::Change::Lowered);
    EXPECT_EQ(bench.shedder.step(), step);
  }
  EXPECT_EQ(bench.run(1000, kLate), 0);  // there is nothing more to give up
}

TEST(LoadShedder, LostFramesAreLateFrames) {
  Bench bench;
  EXPECT_EQ(bench.run(4, kInTime, true), 1);
}

TEST(LoadShedder, QualityComesBackWhenThereIsRoomForIt) {
  Bench bench;
  bench.run(4, kLate);
  EXPECT_EQ(bench.run(1000, kJustInTime), 0);  // in time, but without room
  EXPECT_EQ(bench.frames_to_raise(), 90);
  bench.run(8, kLate);
  EXPECT_EQ(bench.shedder.step(), 2);
  EXPECT_GT(bench.frames_to_raise(), 0);
  EXPECT_GT(bench.frames_to_raise(), 0);
  EXPECT_EQ(bench.shedder.step(), 0);
}

TEST(LoadShedder, ALateFrameNowAndThenDelaysTheReturnAndDoesNotPreventIt) {
  Bench bench;
  bench.run(4, kLate);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(bench.run(29, kInTime) + bench.run(1, kLate), 0);
  EXPECT_EQ(bench.frames_to_raise(), 90 - 4 * 19);
}

TEST(LoadShedder, WhatCameBackTooEarlyWaitsLongerTheNextTime) {
  Bench bench;
  bench.run(4, kLate);
  int expected = 90;
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(bench.frames_to_raise(), expected);
    bench.run(4, kLate);  // and at once it is too much again
    expected = std::min(2 * expected, 8 * 90);
  }
  // Once it holds, the patience shrinks.
  bench.run(4, kLate);
  EXPECT_EQ(bench.frames_to_raise(), 8 * 90);
  EXPECT_EQ(bench.frames_to_raise(), 8 * 90);
  bench.run(400, kJustInTime);
  for (int i = 0; i < 3; ++i) bench.run(4, kLate);
  EXPECT_EQ(bench.frames_to_raise(), 4 * 90);
}

}  // namespace
}  // namespace stillmap
