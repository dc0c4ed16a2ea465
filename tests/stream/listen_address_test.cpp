// SPDX-License-Identifier: Apache-2.0
#include "stream/listen_address.h"

#include <gtest/gtest.h>

namespace stillmap::stream {
namespace {

TEST(ListenAddress, Parses) {
  const auto v4 = parse_listen_address("127.0.0.1:8765");
  ASSERT_TRUE(v4.ok());
  EXPECT_EQ(v4.value().host, "127.0.0.1");
  EXPECT_EQ(v4.value().port, 8765);
  EXPECT_FALSE(v4.value().ipv6);
  const auto by_name = parse_listen_address("localhost:80");
  ASSERT_TRUE(by_name.ok());
  EXPECT_EQ(by_name.value().host, "127.0.0.1");
  EXPECT_EQ(by_name.value().port, 80);
  const auto v6 = parse_listen_address("[::1]:0");
  ASSERT_TRUE(v6.ok());
  EXPECT_EQ(v6.value().host, "::1");
  EXPECT_TRUE(v6.value().ipv6);
}

TEST(ListenAddress, RefusesTheRestNamingKeyValueAndMend) {
  for (const char* text :
       {"", ":", "8765", ":8765", "127.0.0.1", "127.0.0.1:", "127.0.0.1:65536", "127.0.0.1:-1",
        "127.0.0.1:80 ", "127.0.0.1: 80", "robot:80", "256.0.0.1:80", "::1:80", "[::1]80", "[]:80",
        "[127.0.0.1]:80", "]:80", "[:80", "http://127.0.0.1:80"}) {
    const auto parsed = parse_listen_address(text);
    ASSERT_FALSE(parsed.ok()) << text;
    EXPECT_EQ(parsed.error().exit_code, ExitCode::WrongConfig);
    EXPECT_NE(parsed.error().message.find(std::string("stream.listen: \"") + text), std::string::npos);
    EXPECT_NE(parsed.error().message.find("127.0.0.1:8765"), std::string::npos);
  }
}

TEST(ListenAddress, SaysWhyItCannotListen) {
  EXPECT_TRUE(check_can_listen({.host = "127.0.0.1", .port = 0}).ok());
  const Status foreign = check_can_listen({.host = "192.0.2.1", .port = 0});  // TEST-NET-1, RFC 5737
  ASSERT_FALSE(foreign.ok());
  EXPECT_EQ(foreign.error().exit_code, ExitCode::RunFailed);
  EXPECT_NE(foreign.error().message.find("no such address"), std::string::npos);
}

}  // namespace
}  // namespace stillmap::stream
