// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "core/config.h"

namespace stillmap::config {

using Mount = std::optional<std::array<double, 7>>;
using Maybe = std::optional<double>;
using Triple = std::array<double, 3>;
/// A file's name; relative to the file of the configuration that it stands in.
struct Path {
  std::string* to;
};
/// One of some words.
struct Choice {
  std::string* to;
  std::span<const char* const> words;
};
using Target =
    std::variant<bool*, int*, std::int64_t*, double*, std::string*, Path, Choice, std::vector<std::string>*,
                 std::vector<int>*, Triple*, Mount*, Maybe*, DynamicRule*>;

/// One setting: where it is stored and what may stand there.
struct Key {
  const char* name;
  Target target;
  const char* unit;
  const char* help;
  double min = 0, max = 0;
  bool required = false;
  std::string origin = "default";
};

/// Every key of the configuration.
std::vector<Key> describe(Config& config);

/// The words of track.dynamic_rule.
using Rule = std::pair<const char*, DynamicRule>;
inline constexpr std::array<Rule, 3> kRules{
    {{"off", DynamicRule::Off}, {"paper", DynamicRule::Paper}, {"silhouette", DynamicRule::Silhouette}}};

/// A key's value as TOML writes it, for `check --dump`; what is not set has no TOML: "(unknown)".
std::string value_text(const Target& target);
/// What may stand there, for errors.
std::string expectation(const Key& key);
std::string number_text(double value);
/// As TOML's basic strings are written: what is dumped reads back the same.
std::string quoted(const std::string& text);
/// "[a, b]", each item in the text that `text_of` gives it.
std::string list_text(const auto& items, const auto& text_of) {
  std::string text = "[";
  for (const auto& item : items) text += (text.size() > 1 ? ", " : "") + text_of(item);
  return text + "]";
}

/// Whether the values go together.
Status check_whole(const Config& config);
/// A WrongConfig.
Error wrong(std::string message);

}  // namespace stillmap::config
