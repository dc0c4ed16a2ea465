// SPDX-License-Identifier: Apache-2.0
#include <concepts>
#include <sstream>

#include "core/config_keys.h"

namespace stillmap::config {

std::string number_text(double v) {
  std::ostringstream out;
  out.precision(12);
  out << v;
  return out.str();
}

std::string quoted(const std::string& s) {
  std::string text = "\"";
  for (const char c : s) {
    const auto code = static_cast<unsigned char>(c);
    if (code < 0x20 || code == 0x7f) {
      constexpr const char* kDigits = "0123456789abcdef";
      text += {'\\', 'u', '0', '0', kDigits[code / 16], kDigits[code % 16]};
    } else {
      if (c == '"' || c == '\\') text += '\\';
      text += c;
    }
  }
  return text + "\"";
}

namespace {

/// "a", "b" or "c".
std::string any_of_text(std::span<const char* const> words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i)
    text += (i == 0 ? "" : i + 1 == words.size() ? " or " : ", ") + quoted(words[i]);
  return text;
}

/// A value as TOML writes it.
struct Print {
  std::string operator()(const bool* v) const { return *v ? "true" : "false"; }
  std::string operator()(const std::signed_integral auto* v) const { return std::to_string(*v); }
  std::string operator()(const double* v) const { return number_text(*v); }
  std::string operator()(const std::string* v) const { return quoted(*v); }
  // Qualified: for a string that may be written to, std::quoted would be the better match.
  std::string operator()(const Path& v) const { return config::quoted(*v.to); }
  std::string operator()(const Choice& v) const { return config::quoted(*v.to); }
  std::string operator()(const std::vector<std::string>* v) const { return list_text(*v, quoted); }
  std::string operator()(const std::vector<int>* v) const { return list_text(*v, number_text); }
  std::string operator()(const Triple* v) const { return list_text(*v, number_text); }
  std::string operator()(const Mount* v) const {
    return v->has_value() ? list_text(**v, number_text) : "(unknown)";
  }
  std::string operator()(const Maybe* v) const { return v->has_value() ? number_text(**v) : "(unknown)"; }
  std::string operator()(const DynamicRule* v) const {
    return quoted(std::ranges::find(kRules, *v, &Rule::second)->first);
  }
};

/// What a value may be.
struct Say {
  const std::string& range;
  std::string operator()(const bool*) const { return "true or false"; }
  std::string operator()(const std::signed_integral auto*) const { return "a whole number" + range; }
  std::string operator()(const double*) const { return "a number" + range; }
  std::string operator()(const Maybe*) const { return "a number" + range; }
  std::string operator()(const std::string*) const { return "a text"; }
  std::string operator()(const Path&) const { return "a text"; }
  std::string operator()(const Choice& v) const { return any_of_text(v.words); }
  std::string operator()(const std::vector<std::string>*) const { return "a list of texts"; }
  std::string operator()(const std::vector<int>*) const { return "a list of whole numbers" + range; }
  std::string operator()(const Triple*) const { return "[blue, green, red]" + range; }
  std::string operator()(const Mount*) const {
    return "[x, y, z, qx, qy, qz, qw] in m and a unit quaternion";
  }
  std::string operator()(const DynamicRule*) const { return "\"silhouette\", \"paper\" or \"off\""; }
};

}  // namespace

std::string value_text(const Target& target) {
  return std::visit(Print{}, target);
}

std::string expectation(const Key& key) {
  const std::string unit = *key.unit != '\0' ? std::string(" ") + key.unit : "";
  const std::string range = " from " + number_text(key.min) + " to " + number_text(key.max) + unit;
  return std::visit(Say{range}, key.target);
}

}  // namespace stillmap::config
