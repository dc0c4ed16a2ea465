// SPDX-License-Identifier: Apache-2.0
#include "core/check.h"

#include <gtest/gtest.h>

#include <csignal>

#include "tests/core/stderr_pipe.h"

namespace stillmap {
namespace {

TEST(CheckDeathTest, NamesTheBrokenPromiseAndAborts) {
  EXPECT_EXIT(STILLMAP_CHECK(1 + 1 == 3), ::testing::KilledBySignal(SIGABRT),
              "stillmap: bug: 1 \\+ 1 == 3 does not hold \\(.*check_test.cpp:[0-9]+\\)");
}

TEST(CheckDeathTest, AbortsWhereNobodyReadsStderr) {
  EXPECT_EXIT(
      {
        test::StderrPipe pipe;
        pipe.fill();
        STILLMAP_CHECK(false);
      },
      ::testing::KilledBySignal(SIGABRT), "");
}

}  // namespace
}  // namespace stillmap
