// SPDX-License-Identifier: Apache-2.0
#include "core/whole_file.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "tests/support/temporary_folder.h"

namespace stillmap {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class WholeFileTest : public ::testing::Test {
 protected:
  std::string path(const char* name) const { return folder_ / name; }
  static void expect_refused(const Status& s, const std::string& file) {
    ASSERT_FALSE(s.ok());
    EXPECT_EQ(s.error().exit_code, ExitCode::RunFailed);
    EXPECT_THAT(s.error().message, AllOf(HasSubstr(file), HasSubstr("; "), Not(HasSubstr("\n"))));
  }
  test::TemporaryFolder folder_;
};

TEST_F(WholeFileTest, CheckingLeavesNothingBehind) {
  EXPECT_TRUE(check_writable(path("new.txt")).ok());
  EXPECT_TRUE(fs::is_empty(folder_.path()));
}

TEST_F(WholeFileTest, CheckingLeavesAnExistingFileAlone) {
  folder_.write("old.txt", "kept");
  const auto written = fs::last_write_time(path("old.txt"));
  EXPECT_TRUE(check_writable(path("old.txt")).ok());
  EXPECT_EQ(folder_.read("old.txt"), "kept");
  EXPECT_EQ(fs::last_write_time(path("old.txt")), written);
}

TEST_F(WholeFileTest, RefusesWhatCannotBeWritten) {
  folder_.write("file", "x");
  for (const std::string& wrong :
       {path("none/there.txt"), path("file/below.txt"), std::string("/proc/there.txt")}) {
    expect_refused(check_writable(wrong), wrong);
    expect_refused(write_whole(wrong, "x"), wrong);
  }
  expect_refused(check_writable(folder_.path()), folder_.path());
}

TEST_F(WholeFileTest, WritesWholeAndReplaces) {
  ASSERT_TRUE(write_whole(path("a.json"), "first, which is longer").ok());
  ASSERT_TRUE(write_whole(path("a.json"), std::string_view("second\0", 7)).ok());
  EXPECT_EQ(folder_.read("a.json"), std::string("second\0", 7));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), {}), 1);
}

TEST_F(WholeFileTest, AFullDiskLeavesTheOldFile) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "needs /dev/full";
  expect_refused(write_whole("/dev/full", "x"), "/dev/full");
  folder_.write("a.json", "old");
  fs::create_symlink("/dev/full", path("a.json.tmp"));  // where the new text goes first
  expect_refused(write_whole(path("a.json"), "new"), "a.json");
  EXPECT_EQ(folder_.read("a.json"), "old");
  EXPECT_FALSE(fs::is_symlink(path("a.json.tmp"))) << "half a file is left behind";
}

TEST_F(WholeFileTest, DevicesAreWrittenDirectly) {
  EXPECT_TRUE(check_writable("/dev/null").ok());
  EXPECT_TRUE(write_whole("/dev/null", "x").ok());
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST_F(WholeFileTest, ALinkStaysOneAndWhatItLeadsToIsReplaced) {
  folder_.write("room", "old");
  fs::create_symlink("room", path("link"));
  ASSERT_TRUE(write_whole(path("link"), "new").ok());
  EXPECT_TRUE(fs::is_symlink(path("link")));
  EXPECT_EQ(folder_.read("room"), "new");
}

/// The file's length is what the two are measured by.
class EarlierFileTest : public WholeFileTest {
 protected:
  void write(std::size_t bytes, EarlierFile& earlier) {
    WholeFile file(path("m.map"), std::numeric_limits<Nanoseconds>::max(), &earlier);
    file.append(std::string(bytes, 'x'));
    ASSERT_TRUE(file.finish().ok());
    EXPECT_EQ(fs::file_size(path("m.map")), bytes);
  }
  std::size_t files() const {
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder_.path()), {}));
  }
};

TEST_F(EarlierFileTest, IsKeptBesideWhatHoldsLessThanHalf) {
  folder_.write("m.map", std::string(101, 'o'));
  folder_.write("m.1.map", "another's");
  EarlierFile earlier;
  write(50, earlier);
  EXPECT_EQ(earlier.kept_as(), path("m.2.map"));
  EXPECT_EQ(folder_.read("m.2.map"), std::string(101, 'o'));
  write(10, earlier);  // this run's own is no earlier one
  EXPECT_EQ(files(), 3U);
  EarlierFile of_the_next_run;
  write(5, of_the_next_run);
  EXPECT_EQ(of_the_next_run.kept_as(), "");
  EXPECT_EQ(folder_.read("m.1.map"), "another's");
}

TEST_F(EarlierFileTest, IsReplacedByItsLike) {
  folder_.write("m.map", std::string(100, 'o'));
  EarlierFile earlier;
  write(50, earlier);
  EXPECT_EQ(files(), 1U);
}

TEST_F(EarlierFileTest, GoesWhenTheRunHasGrown) {
  folder_.write("m.map", std::string(100, 'o'));
  EarlierFile earlier;
  write(1, earlier);
  write(49, earlier);
  EXPECT_EQ(files(), 2U);
  write(50, earlier);
  EXPECT_EQ(files(), 1U);
  EXPECT_EQ(earlier.kept_as(), "");
  write(1, earlier);
  EXPECT_EQ(files(), 1U);
}

TEST_F(EarlierFileTest, WhatCannotBeWrittenLeavesItInItsPlace) {
  folder_.write("m.map", std::string(100, 'o'));
  fs::create_directory(path("m.map.tmp"));
  EarlierFile earlier;
  WholeFile file(path("m.map"), std::numeric_limits<Nanoseconds>::max(), &earlier);
  EXPECT_FALSE(file.finish().ok());
  EXPECT_EQ(fs::file_size(path("m.map")), 100U);
  EXPECT_EQ(files(), 2U);
}

}  // namespace
}  // namespace stillmap
