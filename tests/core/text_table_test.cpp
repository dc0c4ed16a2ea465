// SPDX-License-Identifier: Apache-2.0
#include "core/text_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

namespace stillmap {
namespace {

using testing::ElementsAre;

TEST(ParseStamp, IsExact) {
  EXPECT_EQ(parse_stamp("1305031239.529662"), 1305031239529662000);  // a double would say ...529661893
  EXPECT_EQ(parse_stamp("1305031239.529662123"), 1305031239529662123);
  EXPECT_EQ(parse_stamp("0.600000"), 600'000'000);
  EXPECT_EQ(parse_stamp("7"), 7'000'000'000);
  EXPECT_EQ(parse_stamp("7."), 7'000'000'000);
  EXPECT_EQ(parse_stamp(".5"), 500'000'000);
  EXPECT_EQ(parse_stamp("0"), 0);
  EXPECT_EQ(parse_stamp("000000000000000000000000000001.25"), 1'250'000'000);
}

TEST(ParseStamp, RoundsBeyondTheNinthDecimal) {
  EXPECT_EQ(parse_stamp("1.0000000014"), 1'000'000'001);
  EXPECT_EQ(parse_stamp("1.0000000015"), 1'000'000'002);
  EXPECT_EQ(parse_stamp("1.9999999999"), 2'000'000'000);
  EXPECT_EQ(parse_stamp("0.00000000004"), 0);
}

TEST(ParseStamp, TakesTheExponentThatOtherToolsWrite) {
  EXPECT_EQ(parse_stamp("1.305031239529662e+09"), 1305031239529662000);
  EXPECT_EQ(parse_stamp("1305031239529662000E-9"), 1305031239529662000);
  EXPECT_EQ(parse_stamp("1.5e0"), 1'500'000'000);
  EXPECT_EQ(parse_stamp("5e-10"), 1);
  EXPECT_EQ(parse_stamp("4e-10"), 0);
  EXPECT_EQ(parse_stamp("9e-30"), 0);
}

TEST(ParseStamp, RefusesWhatIsNoStamp) {
  for (const char* text : {"",
                           ".",
                           "-1",
                           "+1",
                           "1.2.3",
                           "1,5",
                           "abc",
                           "1s",
                           "0x10",
                           "nan",
                           "inf",
                           "1e",
                           "1e+",
                           "1e+-2",
                           "1e2.5",
                           "e5",
                           "1 2",
                           " 1",
                           "1e31",
                           "1e99999999999",
                           "9000000001",
                           "99999999999999999999",
                           "1305031239529662000"}) {
    EXPECT_EQ(parse_stamp(text), std::nullopt) << text;
  }
}

TEST(StampText, IsReadBackExactly) {
  EXPECT_EQ(stamp_text(1305031239529662000), "1305031239.529662000");
  EXPECT_EQ(stamp_text(5), "0.000000005");
  for (const Nanoseconds t : {0LL, 1LL, 999'999'999LL, 1'000'000'000LL, 1305031239529662123LL}) {
    EXPECT_EQ(parse_stamp(stamp_text(t)), t);
  }
}

class Table : public testing::Test {
 protected:
  Table() : path_(testing::TempDir() + "stillmap-table-" + std::to_string(getpid())) {}
  ~Table() override { std::filesystem::remove(path_); }
  std::vector<TextRow> read(const std::string& text) {
    std::ofstream(path_, std::ios::binary) << text;
    const auto rows = read_text_table(path_);
    EXPECT_TRUE(rows.ok());
    return rows.ok() ? rows.value() : std::vector<TextRow>{};
  }
  std::string path_;
};

TEST_F(Table, SplitsAndCountsLines) {
  const auto rows = read("\xEF\xBB\xBF# c\r\n\r\n a\tb ,c\r\n\n#\n  # also a comment\n,, d");
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[0].line, 3);
  EXPECT_THAT(rows[0].columns, ElementsAre("a", "b", "c"));
  EXPECT_EQ(rows[1].line, 7);
  EXPECT_THAT(rows[1].columns, ElementsAre("d"));
  EXPECT_TRUE(read("").empty());
  EXPECT_TRUE(read("\r\n \t\n").empty());
}

TEST_F(Table, WhatCannotBeReadIsNamed) {
  ASSERT_EQ(mkfifo(path_.c_str(), 0600), 0);
  for (const std::string& path :
       {std::string("/no/such/file"), testing::TempDir(), std::string("/dev/zero"), path_}) {
    const auto rows = read_text_table(path);
    ASSERT_FALSE(rows.ok());
    EXPECT_EQ(rows.error().exit_code, ExitCode::UnreadableInput);
    EXPECT_THAT(rows.error().message, testing::HasSubstr(path + ": cannot be read: "));
  }
}

}  // namespace
}  // namespace stillmap
