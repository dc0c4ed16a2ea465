// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "stream/access.h"
#include "stream/client_message.h"
#include "tests/fuzz/targets.h"

namespace stillmap::fuzz {

namespace {

constexpr std::string_view kToken = "0123456789abcdef0123456789abcdef";

stream::Access make_access(bool with_token) {
  Config::Stream config;
  const auto file =
      std::filesystem::temp_directory_path() / ("stillmap_fuzz_token_" + std::to_string(getpid()));
  if (with_token) {
    config.token_file = file;
    config.listen = "0.0.0.0:0";
    std::ofstream(file) << kToken << "\n";
    std::filesystem::permissions(file, std::filesystem::perms::owner_read);
  }
  const auto address = stream::parse_listen_address(config.listen);
  auto access = stream::Access::open(config, address.value());
  std::filesystem::remove(file);
  require(access.ok());
  return std::move(access.value());
}

}  // namespace

void parse_message(Bytes bytes) {
  // A copy of its own length, so that reading beyond it shows.
  const std::vector<char> json(bytes.begin(), bytes.end());
  const std::string_view text{json.data(), json.size()};
  using Kind = stream::ClientMessage::Kind;
  const Kind kind = stream::parse_client_message(text).kind;
  require(kind != Kind::Subscribe || text.find("subscribe") != std::string_view::npos);
  // Something behind the end makes it another message, and none.
  if (kind != Kind::Malformed)
    require(stream::parse_client_message(std::string(text) + "}").kind == Kind::Malformed);
}

void judge_request(Bytes bytes) {
  static const stream::Access open = make_access(false), guarded = make_access(true);
  std::array<std::vector<char>, 4> parts;
  std::size_t part = 0;
  for (const std::uint8_t byte : bytes) {
    if (byte == '\n' && part + 1 < parts.size()) {
      ++part;
    } else {
      parts[part].push_back(static_cast<char>(byte));
    }
  }
  const auto view = [&](std::size_t i) { return std::string_view(parts[i].data(), parts[i].size()); };
  const stream::RequestFacts request{view(0), view(1), view(2), view(3)};
  using Verdict = stream::Access::Verdict;
  for (const bool web_socket : {false, true}) {
    static_cast<void>(open.judge(request, web_socket));
    // Nobody comes in who does not know the token.
    const bool knows = request.token == kToken || request.cookies.find(kToken) != std::string_view::npos;
    if (!knows) require(guarded.judge(request, web_socket) != Verdict::Welcome);
  }
}

}  // namespace stillmap::fuzz
