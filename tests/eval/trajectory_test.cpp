// SPDX-License-Identifier: Apache-2.0
#include "eval/trajectory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <iterator>

#include "tests/support/temporary_folder.h"

namespace stillmap {
namespace {

using testing::HasSubstr;

class Trajectory : public testing::Test {
 protected:
  void write(const std::string& text) const { folder_.write("t.txt", text); }
  std::string text() const { return folder_.read("t.txt"); }
  std::string error(const std::string& written) {
    write(written);
    const auto read = read_trajectory(path_);
    EXPECT_FALSE(read.ok()) << written;
    if (read.ok()) return "";
    EXPECT_EQ(read.error().exit_code, ExitCode::UnreadableInput);
    EXPECT_THAT(read.error().message, HasSubstr(path_));
    return read.error().message;
  }
  test::TemporaryFolder folder_;
  std::string path_ = folder_ / "t.txt";
};

TEST_F(Trajectory, ReadsTheBenchmarksFormat) {
  // A quarter turn about z: camera x points along world y.
  write("# comment\r\n\r\n1305031239.529662 1 2.5 -3 0 0 0.70711 0.70711\r\n1.305031240e+09\t0,0,0,0,0,0,-1");
  const auto read = read_trajectory(path_);
  ASSERT_TRUE(read.ok()) << read.error().message;
  ASSERT_EQ(read.value().size(), 2u);
  const StampedPose& first = read.value()[0];
  EXPECT_EQ(first.stamp_ns, 1305031239529662000);
  const Vec3 p = first.T_world_camera * Vec3{1, 0, 0};
  EXPECT_NEAR(p.x, 1, 1e-12);
  EXPECT_NEAR(p.y, 3.5, 1e-12);
  EXPECT_NEAR(p.z, -3, 1e-12);
  EXPECT_EQ(read.value()[1].stamp_ns, 1305031240000000000);
}

TEST_F(Trajectory, SortsAndKeepsTheLastOfEqualStamps) {
  write("2 0 0 0 0 0 0 1\n1 5 0 0 0 0 0 1\n2 7 0 0 0 0 0 1\n");
  const auto read = read_trajectory(path_);
  ASSERT_TRUE(read.ok());
  ASSERT_EQ(read.value().size(), 2u);
  EXPECT_EQ(read.value()[0].T_world_camera.t.x, 5);
  EXPECT_EQ(read.value()[1].T_world_camera.t.x, 7);
}

TEST_F(Trajectory, ErrorsNameTheLine) {
  EXPECT_THAT(error(""), HasSubstr("holds no pose"));
  EXPECT_THAT(error("# only\n\n"), HasSubstr("holds no pose"));
  EXPECT_THAT(error("#\n1 0 0 0 0 0 1\n"), HasSubstr(":2: 7 columns, expected 8"));
  EXPECT_THAT(error("1 0 0 0 0 0 0 1 9\n"), HasSubstr(":1: 9 columns"));
  EXPECT_THAT(error("1 0 0 0 0 0 0 1\nx 0 0 0 0 0 0 1\n"), HasSubstr(":2: 'x' is not a stamp"));
  EXPECT_THAT(error("-1 0 0 0 0 0 0 1\n"), HasSubstr("'-1' is not a stamp"));
  EXPECT_THAT(error("1 0 nan 0 0 0 0 1\n"), HasSubstr("'nan' is not a finite number"));
  EXPECT_THAT(error("1 0 0 inf 0 0 0 1\n"), HasSubstr("'inf'"));
  EXPECT_THAT(error("1 0 0 1e999 0 0 0 1\n"), HasSubstr("'1e999'"));
  EXPECT_THAT(error("1 0 0 1m 0 0 0 1\n"), HasSubstr("'1m'"));
  EXPECT_THAT(error("1 0 0 0 0 0 0 0\n"), HasSubstr("no unit quaternion"));
  EXPECT_THAT(error("1 0 0 0 0 0 0 2\n"), HasSubstr("no unit quaternion"));
}

TEST_F(Trajectory, UnreadableFileIsNamedWithTheReason) {
  for (const std::string& path : {path_, folder_.path().string()}) {
    const auto read = read_trajectory(path);
    ASSERT_FALSE(read.ok());
    EXPECT_THAT(read.error().message, testing::AllOf(HasSubstr(path), HasSubstr("cannot be read")));
  }
}

TEST_F(Trajectory, WritesFixedDecimalsWithAHeader) {
  const std::vector<StampedPose> poses{{1305031239529662000, {{}, {1, -2.5, 1e-7}}},
                                       {5, {rotation_from({-1, 0, 0, 1}), {123456.7890123, 0, 0}}}};
  ASSERT_TRUE(write_trajectory(path_, poses, "T_map_camera").ok());
  EXPECT_EQ(text(),
            "# T_map_camera\n# timestamp tx ty tz qx qy qz qw\n"
            "1305031239.529662000 1.000000 -2.500000 0.000000 0.00000000 0.00000000 0.00000000 1.00000000\n"
            "0.000000005 123456.789012 0.000000 0.000000 0.00000000 0.00000000 -0.70710678 0.70710678\n");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_.path()), {}), 1)
      << "no temporary file stays";
}

TEST_F(Trajectory, ReadsBackWhatItWrote) {
  std::vector<StampedPose> poses;
  for (int i = 0; i < 100; ++i) {
    const Vec3 turn{0.03 * i, 2 - 0.05 * i, 0.01 * i};
    poses.push_back({1305031239529662000 + i * 33'333'333LL, {exp_so3(turn), {0.1 * i, -0.2 * i, 3}}});
  }
  ASSERT_TRUE(write_trajectory(path_, poses, "h").ok());
  const auto read = read_trajectory(path_);
  ASSERT_TRUE(read.ok());
  ASSERT_EQ(read.value().size(), poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_EQ(read.value()[i].stamp_ns, poses[i].stamp_ns);
    const Pose difference = inverse(read.value()[i].T_world_camera) * poses[i].T_world_camera;
    EXPECT_LT(norm(difference.t), 1e-6);
    EXPECT_LT(norm(log_so3(difference.R)), 4e-8);
  }
}

TEST_F(Trajectory, AnOutputThatCannotBeWrittenIsNamed) {
  const std::string nowhere = folder_ / "missing/t.txt";
  const Status status = write_trajectory(nowhere, {}, "h");
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().exit_code, ExitCode::RunFailed);
  EXPECT_THAT(status.error().message,
              testing::AllOf(HasSubstr(nowhere), HasSubstr("No such file or directory")));
  const std::vector<StampedPose> many(100'000);
  const Status full = write_trajectory("/dev/full", many, "h");
  ASSERT_FALSE(full.ok());
  EXPECT_THAT(full.error().message, HasSubstr("No space left"));
  EXPECT_TRUE(std::filesystem::is_character_file("/dev/full")) << "a device must never be renamed over";
}

TEST_F(Trajectory, AFailedWriteLeavesTheOldFile) {
  write("old");
  std::filesystem::create_directory(path_ + ".tmp");  // the temporary name is taken, so writing must fail
  EXPECT_FALSE(write_trajectory(path_, {}, "h").ok());
  EXPECT_EQ(text(), "old");
}

}  // namespace
}  // namespace stillmap
