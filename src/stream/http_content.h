// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstring>
#include <string_view>

#include "core/arena.h"
#include "core/latest_value.h"

namespace stillmap::stream {

constexpr std::size_t kMaxHealthBytes = 4096, kMaxMetricsBytes = 12288;

struct HttpReply {
  unsigned status = 200;
  const char* type = "text/plain";
  std::string_view body;  ///< until the next call of `find`
};

/// What the HTTP paths answer: the page, and the newest health texts.
class HttpContent {
 public:
  explicit HttpContent(Arena& arena) : texts_(arena.take<LatestValue<Texts>>("stream.health", 1)) {}

  /// Any one thread. False, and nothing is published, when a text is too long.
  [[nodiscard]] bool publish(std::string_view health_json, std::string_view metrics);
  /// Stream thread.
  HttpReply find(std::string_view path);

 private:
  struct Texts {
    std::size_t health_bytes = 0, metrics_bytes = 0;
    std::array<char, kMaxHealthBytes> health{};
    std::array<char, kMaxMetricsBytes> metrics{};
  };
  std::span<LatestValue<Texts>> texts_;
};

}  // namespace stillmap::stream
