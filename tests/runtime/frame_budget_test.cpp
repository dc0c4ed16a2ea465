// SPDX-License-Identifier: Apache-2.0
#include "runtime/frame_budget.h"

#include <gtest/gtest.h>

namespace stillmap {
namespace {

TEST(FrameBudget, IsWhatMayBeHeldAtOnce) {
  const std::size_t whole = frame_budget({.detector = true, .log = true}).sum();
  EXPECT_EQ(whole - frame_budget({.detector = true}).sum(),
            kReadAheadRing);                                 // a camera is not read ahead, but has a spare
  EXPECT_EQ(whole - frame_budget({.log = true}).sum(), 2u);  // waiting and at work
}

TEST(FrameBudget, LockstepKeepsTheFramesOfALateDetector) {
  const std::size_t whole = frame_budget({.detector = true, .log = true}).sum();
  EXPECT_EQ(frame_budget({.detector = true, .log = true, .lockstep_delay = 2}).sum(),
            whole);  // fewer than the threads would hold
  EXPECT_EQ(frame_budget({.detector = true, .log = true, .lockstep_delay = 60}).sum(), 64u);
}

}  // namespace
}  // namespace stillmap
