// SPDX-License-Identifier: Apache-2.0
#include "runtime/watchdog.h"

#include <gtest/gtest.h>

namespace stillmap {
namespace {

constexpr Nanoseconds kSecond = 1'000'000'000, kStart = 5 * kSecond;

TEST(Watchdog, AStageThatWaitsIsNeverLate) {
  Watchdog dog;
  for (int s = 0; s < kStageCount; ++s) EXPECT_FALSE(dog.late(static_cast<Stage>(s), 3600 * kSecond));
  dog.begin(Stage::Track, kStart);
  dog.end(Stage::Track);
  EXPECT_FALSE(dog.late(Stage::Track, 3600 * kSecond));
  EXPECT_FALSE(dog.stuck(3600 * kSecond));
}

TEST(Watchdog, NamesTheStageThatIsLate) {
  Watchdog dog;
  dog.begin(Stage::Track, kStart);
  dog.begin(Stage::Detect, kStart);
  EXPECT_FALSE(dog.late(Stage::Track, kStart + kSecond / 5));
  EXPECT_TRUE(dog.late(Stage::Track, kStart + kSecond / 2));
  EXPECT_FALSE(dog.late(Stage::Detect, kStart + kSecond / 2));  // it may take long
  EXPECT_TRUE(dog.late(Stage::Detect, kStart + 3 * kSecond));
  EXPECT_FALSE(dog.late(Stage::Map, kStart + 3 * kSecond));
  EXPECT_EQ(dog.busy(Stage::Track, kStart + 7), 7);
  dog.begin(Stage::Track, kStart + 3 * kSecond);
  EXPECT_FALSE(dog.late(Stage::Track, kStart + 3 * kSecond + 1));
}

TEST(Watchdog, ASilentCameraIsLateButNothingThatARestartMends) {
  Watchdog dog;
  dog.begin(Stage::Capture, kStart);
  EXPECT_TRUE(dog.late(Stage::Capture, kStart + 60 * kSecond));
  EXPECT_FALSE(dog.stuck(kStart + 60 * kSecond));
  dog.begin(Stage::Detect, kStart);
  EXPECT_FALSE(dog.stuck(kStart + 9 * kSecond));
  EXPECT_TRUE(dog.stuck(kStart + 11 * kSecond));
}

}  // namespace
}  // namespace stillmap
