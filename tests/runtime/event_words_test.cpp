// SPDX-License-Identifier: Apache-2.0
#include "runtime/event_words.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <regex>
#include <set>

#include "tests/runtime/wall_scene.h"

namespace stillmap {
namespace {

using ::testing::StartsWith;

constexpr int kCodes = static_cast<int>(EventCode::SourceTimeJump) + 1;

LogWords words(EventCode code, std::int64_t a) {
  return event_words({.code = code, .sequence = 68, .a = a}, test::WallScene::config(), "/dev/video0: busy");
}

TEST(EventWords, AfterTheCodeComeWordsWithUnitAndKey) {
  EXPECT_EQ(words(EventCode::TrackingStarted, 897).text,
            "tracking_started at frame 68: the first pose, from 897 points");
  EXPECT_EQ(words(EventCode::StageLate, 386).text, "stage_late at frame 68: at work on one thing for 386 ms");
  EXPECT_EQ(words(EventCode::SourceStalled, 2100).text,
            "source_stalled: no frame for 2100 ms, camera.stall_s = 2 s; tried anew for up to "
            "camera.give_up_s = 30 s");
  EXPECT_EQ(words(EventCode::SourceRefused, 3).text, "source_refused: try 3: /dev/video0: busy");
  EXPECT_EQ(words(EventCode::QualityLowered, 1).text,
            "quality_lowered at frame 68: to detector on every 3rd frame, since poses come late");
  EXPECT_EQ(words(EventCode::QualityLowered, 1).level, LogLevel::Warning);
  EXPECT_EQ(words(EventCode::SourceBack, 1).level, LogLevel::Info);
}

TEST(EventWords, EachCodeHasItsOwnAndNamesKeysThatThereAre) {
  const auto keys =
      load_config(std::vector<std::string>{STILLMAP_SOURCE_DIR "/firmware-config/cameras/tum-fr1.toml"}, {});
  ASSERT_TRUE(keys.ok());
  std::set<std::string> said;
  int named = 0;
  for (int i = 0; i < kCodes; ++i) {
    const auto code = static_cast<EventCode>(i);
    const std::string text = words(code, 1).text;
    EXPECT_THAT(text, StartsWith(to_string(code)));
    EXPECT_GT(text.size(), std::string(to_string(code)).size() + 20) << text;
    EXPECT_TRUE(said.insert(text).second) << text;
    const std::regex key("\\b(camera|track|stream|detector)\\.[a-z_]+\\b");
    for (std::sregex_iterator it(text.begin(), text.end(), key), end; it != end; ++it, ++named) {
      const auto is_it = [&](const ConfigEntry& e) { return e.key.starts_with(it->str()); };
      EXPECT_TRUE(std::ranges::any_of(keys.value().entries, is_it)) << text;
    }
  }
  EXPECT_GT(named, 8);
}

TEST(EventWords, OfADropTheReasonAndWhatItMeans) {
  CameraModel camera;
  camera.width = 640, camera.height = 480;
  EXPECT_EQ(drop_words(DropReason::WrongSize, camera),
            "wrong_size (not of camera.width x camera.height = 640 x 480 px)");
  std::set<std::string> said;
  for (int i = 0; i < kDropReasonCount; ++i)
    EXPECT_TRUE(said.insert(drop_words(static_cast<DropReason>(i), camera)).second) << i;
}

}  // namespace
}  // namespace stillmap
