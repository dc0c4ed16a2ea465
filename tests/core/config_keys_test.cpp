// SPDX-License-Identifier: Apache-2.0
// What holds for every key of the configuration, found by asking the configuration for its keys: a new key is
// tested by being there.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "core/config.h"

namespace stillmap {
namespace {

using testing::HasSubstr;

const std::string kCamera = STILLMAP_SOURCE_DIR "/firmware-config/cameras/tum-fr1.toml";

std::vector<ConfigEntry> every_key() {
  const auto loaded = load_config(std::vector<std::string>{kCamera}, {});
  EXPECT_TRUE(loaded.ok()) << loaded.error().message;
  return loaded.ok() ? loaded.value().entries : std::vector<ConfigEntry>{};
}

/// The error of the camera file plus one override; empty where there is none.
std::string error_of(const std::string& set) {
  const auto loaded = load_config(std::vector<std::string>{kCamera}, std::vector<std::string>{set});
  if (loaded.ok()) return "";
  EXPECT_EQ(loaded.error().exit_code, ExitCode::WrongConfig);
  EXPECT_EQ(loaded.error().message.find('\n'), std::string::npos) << "one line: " << loaded.error().message;
  return loaded.error().message;
}

TEST(ConfigKeys, ThereAreManyEachWithHelp) {
  const auto keys = every_key();
  EXPECT_GT(keys.size(), 45u);
  for (const ConfigEntry& key : keys) {
    EXPECT_FALSE(key.help.empty()) << key.key;
    EXPECT_FALSE(key.origin.empty()) << key.key;
  }
}

TEST(ConfigKeys, AMisspeltOneIsRefusedWithTheNearest) {
  for (const ConfigEntry& key : every_key()) {
    EXPECT_THAT(error_of(key.key + "_ = 1"), testing::AllOf(HasSubstr("unknown key '" + key.key + "_'"),
                                                            HasSubstr("did you mean '" + key.key + "'?")));
  }
}

TEST(ConfigKeys, AWrongTypeIsRefusedWithWhatWasExpected) {
  for (const ConfigEntry& key : every_key()) {
    const bool is_text = key.value.starts_with('"'), is_flag = key.value == "true" || key.value == "false";
    for (const std::string& wrong :
         is_text ? std::vector<std::string>{"5", "true", "[\"a\"]", "{a = 1}"}
                 : std::vector<std::string>{"\"text\"", is_flag ? "1" : "true", "[true]", "1979-05-27"}) {
      EXPECT_THAT(
          error_of(key.key + " = " + wrong),
          testing::AllOf(HasSubstr("--set: key '" + key.key + "' = "), HasSubstr("does not fit; expected ")))
          << wrong;
    }
  }
}

TEST(ConfigKeys, NumbersOutOfRangeAreRefusedWithTheUnit) {
  int with_range = 0;
  for (const ConfigEntry& key : every_key()) {
    const std::string expected = error_of(key.key + " = true");
    const std::size_t from = expected.find("number from ");
    if (from == std::string::npos) continue;
    ++with_range;
    std::string to;
    double low = 0, high = 0;
    std::istringstream(expected.substr(from + std::string("number from ").size())) >> low >> to >> high;
    ASSERT_EQ(to, "to") << expected;
    ASSERT_LT(low, high) << key.key;
    EXPECT_THAT(expected, testing::EndsWith(key.unit)) << key.key;
    const bool whole = expected.find("whole number") != std::string::npos;
    const auto text = [&](double v) {
      std::ostringstream out;
      out.precision(17);
      out << v;
      return whole ? std::to_string(static_cast<long long>(v)) : out.str();
    };
    const double below = whole ? low - 1 : low - 1e-6, above = whole ? high + 1 : high * (1 + 1e-6);
    EXPECT_THAT(error_of(key.key + " = " + text(below)), HasSubstr("does not fit"))
        << key.key << " " << text(below);
    EXPECT_THAT(error_of(key.key + " = " + text(above)), HasSubstr("does not fit"))
        << key.key << " " << text(above);
    EXPECT_THAT(error_of(key.key + " = " + text(low)), testing::Not(HasSubstr("does not fit"))) << key.key;
    EXPECT_THAT(error_of(key.key + " = " + text(high)), testing::Not(HasSubstr("does not fit"))) << key.key;
    if (whole) {
      EXPECT_THAT(error_of(key.key + " = 1.5"), HasSubstr("does not fit; expected a whole number"))
          << key.key;
      EXPECT_THAT(error_of(key.key + " = 99999999999999999"), HasSubstr("does not fit")) << key.key;
    } else {
      EXPECT_THAT(error_of(key.key + " = nan"), HasSubstr("does not fit")) << key.key;
      EXPECT_THAT(error_of(key.key + " = inf"), HasSubstr("does not fit")) << key.key;
    }
  }
  EXPECT_GT(with_range, 30);
}

TEST(ConfigKeys, EachRequiredOneMissingIsNamedWithTheMend) {
  const std::vector<std::pair<std::string, std::string>> required{{"camera.width", "640"},
                                                                  {"camera.height", "480"},
                                                                  {"camera.fx", "500"},
                                                                  {"camera.fy", "500"},
                                                                  {"camera.cx", "320"},
                                                                  {"camera.cy", "240"},
                                                                  {"camera.depth_units_per_m", "1000"}};
  const auto load_without = [&](const std::string& left_out) {
    std::vector<std::string> sets;
    for (const auto& [key, value] : required) {
      if (key != left_out) sets.push_back(key + "=" + value);
    }
    return load_config({}, sets);
  };
  EXPECT_TRUE(load_without("").ok()) << "these are all that is required";
  for (const auto& [key, value] : required) {
    const auto loaded = load_without(key);
    ASSERT_FALSE(loaded.ok()) << key;
    EXPECT_EQ(loaded.error().exit_code, ExitCode::WrongConfig);
    EXPECT_THAT(loaded.error().message,
                testing::AllOf(HasSubstr("key '" + key + "' is missing; expected "), HasSubstr("--config")));
  }
}

}  // namespace
}  // namespace stillmap
