// SPDX-License-Identifier: Apache-2.0
#include "stream/http_content.h"

#include <gtest/gtest.h>

#include <string>

namespace stillmap::stream {
namespace {

TEST(HttpContent, HealthIsUnavailableUntilItIsPublished) {
  Arena arena(1 << 20);
  HttpContent content(arena);
  EXPECT_EQ(content.find("/health").status, 503U);
  EXPECT_EQ(content.find("/metrics").status, 503U);
  EXPECT_EQ(content.find("/").status, 200U);
  ASSERT_TRUE(content.publish("{}", "a 1\n"));
  EXPECT_EQ(content.find("/health").status, 200U);
  EXPECT_EQ(content.find("/health").body, "{}");
  ASSERT_TRUE(content.publish("{\"a\":1}", ""));
  EXPECT_EQ(content.find("/health").body, "{\"a\":1}");
  EXPECT_EQ(content.find("/metrics").body, "");
}

TEST(HttpContent, OtherPathsAreNotFound) {
  Arena arena(1 << 20);
  HttpContent content(arena);
  for (const char* path : {"", "/health/", "/Health", "//", "/index.html"}) {
    EXPECT_EQ(content.find(path).status, 404U) << path;
  }
}

TEST(HttpContent, TextsThatAreTooLongLeaveTheOldOnes) {
  Arena arena(1 << 20);
  HttpContent content(arena);
  ASSERT_TRUE(content.publish("old", "old"));
  EXPECT_FALSE(content.publish(std::string(kMaxHealthBytes + 1, 'x'), "new"));
  EXPECT_FALSE(content.publish("new", std::string(kMaxMetricsBytes + 1, 'x')));
  EXPECT_EQ(content.find("/health").body, "old");
  EXPECT_TRUE(content.publish(std::string(kMaxHealthBytes, 'x'), std::string(kMaxMetricsBytes, 'x')));
  EXPECT_EQ(content.find("/metrics").body.size(), kMaxMetricsBytes);
}

TEST(HttpContent, ThePageLoadsNothingFromElsewhere) {
  Arena arena(1 << 20);
  const std::string page(HttpContent(arena).find("/").body);
  EXPECT_NE(page.find("Foxglove"), std::string::npos);
  for (const char* outside : {"http://", "https://", "src=", "@import", "url("}) {
    EXPECT_EQ(page.find(outside), std::string::npos) << outside;
  }
}

}  // namespace
}  // namespace stillmap::stream
