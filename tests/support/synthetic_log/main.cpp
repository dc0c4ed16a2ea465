// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <cstdio>
#include <map>
#include <string>

#include "tests/support/synthetic_log/synthetic_log.h"

namespace {

using stillmap::synthetic::PathKind;

constexpr const char* kUsage =
    "usage: stillmap-synth --out DIR [--seed N] [--frames 300] [--people 2] [--path orbit|walk|rotate] "
    "[--no-noise]";

template <class T>
bool parse(const std::string& text, T& value, T max) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() && value >= 0 && value <= max;
}

int refuse(const std::string& what) {
  std::fprintf(stderr, "stillmap-synth: %s; %s\n", what.c_str(), kUsage);
  return static_cast<int>(stillmap::ExitCode::WrongConfig);
}

}  // namespace

int main(int argc, char** argv) {
  const std::map<std::string, PathKind> paths{
      {"orbit", PathKind::Orbit}, {"walk", PathKind::Walk}, {"rotate", PathKind::Rotate}};
  stillmap::synthetic::SyntheticOptions options;
  std::string out;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    if (name == "--no-noise") {
      options.noise = false;
      continue;
    }
    if (i + 1 == argc) return refuse(name + " is unknown or lacks a value");
    const std::string value = argv[++i];
    bool good = false;
    if (name == "--out") {
      out = value;
      good = !out.empty();
    } else if (name == "--seed") {
      good = parse<std::uint64_t>(value, options.seed, UINT64_MAX);
    } else if (name == "--frames") {
      good = parse(value, options.frames, 100'000);
    } else if (name == "--people") {
      good = parse(value, options.people, 16);
    } else if (name == "--path" && paths.contains(value)) {
      options.path = paths.at(value);
      good = true;
    }
    if (!good) return refuse(name + " " + value + " is not understood");
  }
  if (out.empty()) return refuse("--out is missing");
  const stillmap::Status status = stillmap::synthetic::write_synthetic_log(options, out);
  if (status.ok()) return 0;
  std::fprintf(stderr, "stillmap-synth: %s\n", status.error().message.c_str());
  return static_cast<int>(status.error().exit_code);
}
