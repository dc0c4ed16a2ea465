// SPDX-License-Identifier: Apache-2.0
#include "runtime/output_file.h"

#include <gmock/gmock.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

namespace stillmap {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class OutputFile : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("stillmap_output_" + std::to_string(getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string path(const char* name) const { return folder_ / name; }
  std::string text_of(const std::string& file) const {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  static void expect_refused(const Status& s, const std::string& file) {
    ASSERT_FALSE(s.ok());
    EXPECT_EQ(s.error().exit_code, ExitCode::RunFailed);
    EXPECT_THAT(s.error().message, AllOf(HasSubstr(file), HasSubstr("; "), Not(HasSubstr("\n"))));
  }
  fs::path folder_;
};

TEST_F(OutputFile, CheckingLeavesNothingBehind) {
  EXPECT_TRUE(check_writable(path("new.txt")).ok());
  EXPECT_TRUE(fs::is_empty(folder_));
}

TEST_F(OutputFile, CheckingLeavesAnExistingFileAlone) {
  std::ofstream(path("old.txt")) << "kept";
  const auto written = fs::last_write_time(path("old.txt"));
  EXPECT_TRUE(check_writable(path("old.txt")).ok());
  EXPECT_EQ(text_of(path("old.txt")), "kept");
  EXPECT_EQ(fs::last_write_time(path("old.txt")), written);
}

TEST_F(OutputFile, RefusesWhatCannotBeWritten) {
  std::ofstream(path("file")) << "x";
  for (const std::string& wrong :
       {path("none/there.txt"), path("file/below.txt"), std::string("/proc/there.txt")}) {
    expect_refused(check_writable(wrong), wrong);
    expect_refused(write_text(wrong, "x"), wrong);
  }
  expect_refused(check_writable(folder_), folder_);
}

TEST_F(OutputFile, WritesWholeAndReplaces) {
  ASSERT_TRUE(write_text(path("a.json"), "first, which is longer").ok());
  ASSERT_TRUE(write_text(path("a.json"), std::string_view("second\0", 7)).ok());
  EXPECT_EQ(text_of(path("a.json")), std::string("second\0", 7));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), {}), 1);
}

TEST_F(OutputFile, AFullDiskLeavesTheOldFile) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "needs /dev/full";
  expect_refused(write_text("/dev/full", "x"), "/dev/full");
  std::ofstream(path("a.json")) << "old";
  fs::create_symlink("/dev/full", path("a.json.part"));  // where the new text goes first
  expect_refused(write_text(path("a.json"), "new"), "a.json");
  EXPECT_EQ(text_of(path("a.json")), "old");
  EXPECT_FALSE(fs::is_symlink(path("a.json.part"))) << "half a file is left behind";
}

TEST_F(OutputFile, DevicesAreWrittenDirectly) {
  EXPECT_TRUE(check_writable("/dev/null").ok());
  EXPECT_TRUE(write_text("/dev/null", "x").ok());
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

}  // namespace
}  // namespace stillmap
