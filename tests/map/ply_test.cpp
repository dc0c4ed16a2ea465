// SPDX-License-Identifier: Apache-2.0
#include "map/ply.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "map_scene.h"

namespace stillmap {
namespace {

namespace fs = std::filesystem;

struct Vertex {
  std::array<float, 3> place{};
  std::array<std::uint8_t, 3> rgb{};
};

/// An independent reader of what the header promises.
std::vector<Vertex> read_ply(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string line;
  std::size_t count = 0;
  std::vector<std::string> properties;
  std::getline(file, line);
  EXPECT_EQ(line, "ply");
  while (std::getline(file, line) && line != "end_header") {
    if (line.starts_with("element vertex ")) count = std::stoul(line.substr(15));
    if (line.starts_with("property ")) properties.push_back(line.substr(9));
  }
  EXPECT_EQ(properties, (std::vector<std::string>{"float x", "float y", "float z", "uchar red", "uchar green",
                                                  "uchar blue"}));
  std::vector<Vertex> vertices(count);
  for (Vertex& v : vertices) {
    file.read(reinterpret_cast<char*>(v.place.data()), 12);
    file.read(reinterpret_cast<char*>(v.rgb.data()), 3);
    EXPECT_TRUE(file.good());
  }
  EXPECT_EQ(file.peek(), EOF) << "bytes after the last vertex";
  return vertices;
}

std::string contents(const fs::path& path) {
  std::ostringstream out;
  out << std::ifstream(path, std::ios::binary).rdbuf();
  return out.str();
}

class Ply : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("stillmap_ply_" + std::to_string(getpid()));
    fs::create_directories(folder_);
    map_.see(test::room(), test::turned(0.4), 3);
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::size_t files() const {
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }

  test::MapUnderTest map_{test::small_camera()};
  fs::path folder_;
};

TEST_F(Ply, holds_every_voxel_with_its_colour) {
  ASSERT_TRUE(write_ply(map_.map().blocks(), map_.map().voxel_m(), folder_ / "m.ply").ok());
  const std::vector<Vertex> vertices = read_ply(folder_ / "m.ply");
  ASSERT_EQ(vertices.size(), map_.map().occupied_voxels());
  std::size_t i = 0;
  map_.map().for_each_occupied([&](const OccupiedVoxel& v) {
    EXPECT_EQ(vertices[i].place, (std::array<float, 3>{v.x, v.y, v.z}));
    EXPECT_EQ(vertices[i++].rgb, (std::array<std::uint8_t, 3>{v.colour.r, v.colour.g, v.colour.b}));
  });
  EXPECT_EQ(files(), 1u) << "no temporary file stays";
}

TEST_F(Ply, replaces_an_older_file_with_the_same_bytes) {
  std::ofstream(folder_ / "m.ply") << std::string(1 << 20, 'x');
  ASSERT_TRUE(write_ply(map_.map().blocks(), map_.map().voxel_m(), folder_ / "m.ply").ok());
  ASSERT_TRUE(write_ply(map_.map().blocks(), map_.map().voxel_m(), folder_ / "n.ply").ok());
  EXPECT_EQ(contents(folder_ / "m.ply"), contents(folder_ / "n.ply"));
}

TEST_F(Ply, an_empty_map_is_a_valid_file) {
  test::MapUnderTest empty(test::small_camera());
  ASSERT_TRUE(write_ply(empty.map().blocks(), empty.map().voxel_m(), folder_ / "m.ply").ok());
  EXPECT_TRUE(read_ply(folder_ / "m.ply").empty());
}

TEST_F(Ply, takes_a_bare_file_name) {
  const fs::path before = fs::current_path();
  fs::current_path(folder_);
  const Status status = write_ply(map_.map().blocks(), map_.map().voxel_m(), "m.ply");
  fs::current_path(before);
  EXPECT_TRUE(status.ok());
  EXPECT_TRUE(fs::exists(folder_ / "m.ply"));
}

TEST_F(Ply, a_missing_folder_is_named) {
  const std::string path = folder_ / "none" / "m.ply";
  const Status status = write_ply(map_.map().blocks(), map_.map().voxel_m(), path);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().exit_code, ExitCode::RunFailed);
  EXPECT_EQ(status.error().message, path +
                                        ": cannot be written: No such file or directory; create the folder "
                                        "first or choose another one");
}

TEST_F(Ply, a_folder_in_the_file_s_place_is_left_alone) {
  fs::create_directories(folder_ / "m.ply" / "inside");
  const Status status = write_ply(map_.map().blocks(), map_.map().voxel_m(), folder_ / "m.ply");
  ASSERT_FALSE(status.ok());
  EXPECT_TRUE(fs::exists(folder_ / "m.ply" / "inside"));
  EXPECT_EQ(files(), 1u) << "the temporary file stays";
}

TEST_F(Ply, a_folder_that_takes_no_files_is_named) {
  const Status status = write_ply(map_.map().blocks(), map_.map().voxel_m(), "/proc/m.ply");
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().message.find("/proc/m.ply"), std::string::npos);
}

TEST_F(Ply, gives_up_after_its_time_and_leaves_the_older_file_whole) {
  std::ofstream(folder_ / "m.ply") << "older";
  const Status status = write_ply(map_.map().blocks(), map_.map().voxel_m(), folder_ / "m.ply", 0);
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().message.find("raise map.save_timeout_s"), std::string::npos);
  EXPECT_EQ(fs::file_size(folder_ / "m.ply"), 5u);
  EXPECT_EQ(files(), 1u) << "the temporary file stays";
}

TEST_F(Ply, a_full_disk_leaves_the_older_file_whole) {
  std::ofstream(folder_ / "m.ply") << "older";
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  rlimit small = before;
  small.rlim_cur = 10'000;
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  const Status status = write_ply(map_.map().blocks(), map_.map().voxel_m(), folder_ / "m.ply");
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  std::signal(SIGXFSZ, old_handler);
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().message.find("free some space"), std::string::npos) << status.error().message;
  EXPECT_EQ(contents(folder_ / "m.ply"), "older");
  EXPECT_EQ(files(), 1u);
}

}  // namespace
}  // namespace stillmap
