// SPDX-License-Identifier: Apache-2.0
#include "stream/access.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

namespace stillmap::stream {
namespace {

using Verdict = Access::Verdict;
constexpr char kToken[] = "0123456789abcdef";

/// A token file that is gone with the test.
struct TokenFile {
  explicit TokenFile(const std::string& text, mode_t mode = 0600) {
    std::ofstream(path) << text;
    chmod(path.c_str(), mode);
  }
  ~TokenFile() { std::filesystem::remove(path); }
  std::string path = testing::TempDir() + "stillmap_token_" + std::to_string(getpid());
};

Result<Access> open(const std::string& host, const std::string& token_file) {
  Config::Stream config;
  config.listen = host + ":8765";
  config.token_file = token_file;
  return Access::open(config, {.host = host, .ipv6 = host.find(':') != std::string::npos});
}

TEST(Access, WithoutATokenOnlyLoopbackIsListenedOn) {
  for (const char* host : {"127.0.0.1", "127.3.2.1", "::1"}) EXPECT_TRUE(open(host, "").ok()) << host;
  for (const char* host : {"0.0.0.0", "192.168.1.7", "::", "fe80::1", "1.127.0.0"}) {
    const Result<Access> access = open(host, "");
    ASSERT_FALSE(access.ok()) << host;
    EXPECT_EQ(access.error().exit_code, ExitCode::WrongConfig);
    EXPECT_NE(access.error().message.find("stream.token_file"), std::string::npos);
  }
}

TEST(Access, ATokenFileThatIsNoneIsRefusedWithTheMendAndWithoutItsText) {
  const auto refused = [](const std::string& text, mode_t mode, const char* why) {
    const TokenFile file(text, mode);
    const Result<Access> access = open("127.0.0.1", file.path);
    ASSERT_FALSE(access.ok()) << text;
    EXPECT_NE(access.error().message.find(why), std::string::npos) << access.error().message;
    EXPECT_EQ(access.error().message.find(text.substr(0, 10)), std::string::npos) << access.error().message;
  };
  refused("short-token-15c\n", 0600, "16 to 128");
  refused(std::string(129, 'x'), 0600, "16 to 128");
  refused("with spaces in its text\n", 0600, "letters, digits");
  refused(kToken, 0640, "chmod 600");
  refused(kToken, 0604, "chmod 600");
  const std::string pipe = testing::TempDir() + "stillmap_token_pipe_" + std::to_string(getpid());
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_NE(open("127.0.0.1", pipe).error().message.find("cannot be read"), std::string::npos);
  unlink(pipe.c_str());
  EXPECT_NE(open("127.0.0.1", "/nowhere").error().message.find("cannot be read"), std::string::npos);
}

TEST(Access, TheTokenOpensByAddressOrCookieAndNothingElseDoes) {
  std::string two_lines(kToken);  // in one expression with the next, GCC 12 warns of what is not there
  two_lines.append("\nanother line\n");
  const TokenFile file(two_lines);
  const Result<Access> opened = open("0.0.0.0", file.path);
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  const Access& access = opened.value();
  for (const char* cookies : {"stillmap_token=0123456789abcdef", "a=b; stillmap_token=0123456789abcdef",
                              "stillmap_token=0123456789abcdef; a=b", ";;  stillmap_token=0123456789abcdef"})
    EXPECT_EQ(access.judge({.host = "any.example", .cookies = cookies}, false), Verdict::Welcome) << cookies;
  EXPECT_EQ(access.judge({.host = "any.example", .token = kToken}, false), Verdict::Welcome);
  for (const char* cookies : {"", "stillmap_token=", "xstillmap_token=0123456789abcdef",
                              "stillmap_token=0123456789abcdeX", "stillmap_token=0123456789abcdef0"})
    EXPECT_EQ(access.judge({.host = "127.0.0.1", .cookies = cookies}, false), Verdict::WrongToken) << cookies;
  for (const char* token : {"", "0123456789abcde", "0123456789abcdef0", "X123456789abcdef"})
    EXPECT_EQ(access.judge({.host = "127.0.0.1", .token = token}, false), Verdict::WrongToken) << token;
}

TEST(Access, WithoutATokenTheHostMustBeThisMachine) {
  const Access access = open("127.0.0.1", "").value();
  for (const char* host : {"127.0.0.1", "127.0.0.1:8765", "localhost:8765", "[::1]:8765", "10.0.0.1"})
    EXPECT_EQ(access.judge({.host = host}, false), Verdict::Welcome) << host;
  for (const char* host : {"", "evil.example", "evil.example:8765", "127.0.0.1.evil.example", "[", "[]",
                           "[::1", "localhost.evil.example", ":8765"})
    EXPECT_EQ(access.judge({.host = host}, false), Verdict::WrongHost) << host;
}

TEST(Access, OnlyPagesThatMayOpenTheWebSocket) {
  const Access access = open("127.0.0.1", "").value();
  const auto judge = [&](const char* origin) {
    return access.judge({.host = "127.0.0.1:8765", .origin = origin}, true);
  };
  for (const char* origin :
       {"", "http://127.0.0.1:8765", "https://127.0.0.1:8765", "https://app.foxglove.dev"})
    EXPECT_EQ(judge(origin), Verdict::Welcome) << origin;
  for (const char* origin : {"null", "http://127.0.0.1:8766", "http://127.0.0.1", "127.0.0.1:8765",
                             "https://app.foxglove.dev.evil.example", "http://app.foxglove.dev", "file://"})
    EXPECT_EQ(judge(origin), Verdict::WrongOrigin) << origin;
  EXPECT_EQ(access.judge({.host = "127.0.0.1:8765", .origin = "https://evil.example"}, false),
            Verdict::Welcome)
      << "what a page may read of HTTP the browser decides";
}

TEST(Access, AFullPreviewLeavesTheMachineOnlyWhenThatIsSaid) {
  const TokenFile file(kToken);
  Config::Stream config;
  config.preview = "full";
  config.token_file = file.path;
  EXPECT_TRUE(Access::open(config, {.host = "127.0.0.1"}).ok());
  EXPECT_FALSE(Access::open(config, {.host = "0.0.0.0"}).ok());
  config.full_preview_to = "network";
  EXPECT_TRUE(Access::open(config, {.host = "0.0.0.0"}).ok());
}

TEST(Access, ConstantTimeComparisonIsAComparison) {
  EXPECT_TRUE(equal_in_constant_time("abc", "abc"));
  for (const char* given : {"", "ab", "abcd", "abd", "xbc"})
    EXPECT_FALSE(equal_in_constant_time(given, "abc")) << given;
  EXPECT_FALSE(equal_in_constant_time(std::string_view("abc\0", 4), "abc"));
}

}  // namespace
}  // namespace stillmap::stream
