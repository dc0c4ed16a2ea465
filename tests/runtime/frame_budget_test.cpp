// SPDX-License-Identifier: Apache-2.0
#include "runtime/frame_budget.h"

#include <gtest/gtest.h>

namespace stillmap {
namespace {

TEST(FrameBudget, IsWhatMayBeHeldAtOnce) {
  const std::size_t whole = frame_budget(true, true, 0).sum();
  EXPECT_EQ(whole - frame_budget(true, false, 0).sum(), kReadAheadRing + 1);  // a camera is not read ahead
  EXPECT_EQ(whole - frame_budget(false, true, 0).sum(), 2 + kDetectedRing + 1);
}

TEST(FrameBudget, LockstepKeepsTheFramesOfALateDetector) {
  const std::size_t whole = frame_budget(true, true, 0).sum();
  EXPECT_EQ(frame_budget(true, true, 2).sum(), whole);  // fewer than the threads would hold
  EXPECT_EQ(frame_budget(true, true, 60).sum(), 64u);
}

}  // namespace
}  // namespace stillmap
