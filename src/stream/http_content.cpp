// SPDX-License-Identifier: Apache-2.0
#include "stream/http_content.h"

#include "stream/viewer_page.h"

namespace stillmap::stream {

bool HttpContent::publish(std::string_view health_json, std::string_view metrics) {
  Texts texts{.health_bytes = health_json.size(), .metrics_bytes = metrics.size()};
  if (texts.health_bytes > texts.health.size() || texts.metrics_bytes > texts.metrics.size()) return false;
  std::memcpy(texts.health.data(), health_json.data(), health_json.size());
  std::memcpy(texts.metrics.data(), metrics.data(), metrics.size());
  texts_[0].publish(texts);
  return true;
}

HttpReply HttpContent::find(std::string_view path) {
  texts_[0].refresh();
  const Texts& texts = texts_[0].value();
  const bool starting = texts_[0].generation() == 0;
  if (path == "/") {
    return {
        200, "text/html; charset=utf-8", {reinterpret_cast<const char*>(kViewerPage), sizeof(kViewerPage)}};
  }
  if (path == "/health") {
    static constexpr char kJson[] = "application/json";
    if (starting) return {503, kJson, "{\"state\":\"starting\"}\n"};
    return {200, kJson, {texts.health.data(), texts.health_bytes}};
  }
  if (path == "/metrics") {
    static constexpr char kPrometheus[] = "text/plain; version=0.0.4";
    if (starting) return {503, kPrometheus, "# starting\n"};
    return {200, kPrometheus, {texts.metrics.data(), texts.metrics_bytes}};
  }
  return {404, "text/plain", "there are /, /health and /metrics\n"};
}

}  // namespace stillmap::stream
