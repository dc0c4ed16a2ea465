// SPDX-License-Identifier: Apache-2.0
// The exported tree as OctoMap's own library reads it.
#include "map/octomap.h"

#include <gtest/gtest.h>
#include <octomap/octomap.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "map_scene.h"

namespace stillmap {
namespace {

namespace fs = std::filesystem;
using test::MapUnderTest;

struct Octomap : testing::Test {
  Octomap() { fs::create_directories(folder); }
  ~Octomap() override { fs::remove_all(folder); }
  fs::path folder = fs::temp_directory_path() / ("stillmap_octomap_" + std::to_string(getpid()));
  std::string path = folder / "room.bt";
};

TEST_F(Octomap, EveryVoxelIsThereAndNoOther) {
  MapUnderTest t(test::small_camera());
  for (int i = 0; i < 6; ++i) t.see(test::room(), test::turned(i), 2);
  ASSERT_TRUE(write_octomap(t.map().blocks(), t.map().voxel_m(), path).ok());
  octomap::OcTree tree(path);  // 0.1 m where it cannot be read
  ASSERT_NEAR(tree.getResolution(), 0.04, 1e-9);
  std::size_t occupied = 0, free = 0, unknown = 0;
  for (int i = 0; i < t.map().blocks().size(); ++i) {
    const BlockCoordinates at = t.map().blocks().block(i).at;
    for (int v = 0; v < kBlockVoxels; ++v) {
      const octomap::point3d centre(static_cast<float>((8 * at.x + v % 8 + 0.5) * 0.04),
                                    static_cast<float>((8 * at.y + v / 8 % 8 + 0.5) * 0.04),
                                    static_cast<float>((8 * at.z + v / 64 + 0.5) * 0.04));
      const octomap::OcTreeNode* node = tree.search(centre);
      const Occupancy here = t.map().blocks().voxels(i)[static_cast<std::size_t>(v)].occupancy();
      ASSERT_EQ(node == nullptr, here == Occupancy::Unknown);
      if (node != nullptr) {
        ASSERT_EQ(tree.isNodeOccupied(node), here == Occupancy::Occupied);
      }
      occupied += here == Occupancy::Occupied;
      free += here == Occupancy::Free;
      unknown += here == Occupancy::Unknown;
    }
  }
  EXPECT_GT(occupied, 10'000u);
  EXPECT_GT(free, 10'000u);
  EXPECT_GT(unknown, 10'000u);
  EXPECT_EQ(tree.getNumLeafNodes(), occupied + free);
}

TEST_F(Octomap, WhatItCannotHoldIsRefusedAndNothingWritten) {
  MapUnderTest t(test::small_camera());
  const Status empty = write_octomap(t.map().blocks(), 0.04, path);
  ASSERT_FALSE(empty.ok());
  EXPECT_EQ(empty.error().exit_code, ExitCode::WrongConfig);
  t.see(test::wall(2), {{}, {2000, 0, 0}}, 2);
  const Status far = write_octomap(t.map().blocks(), 0.04, path);
  ASSERT_FALSE(far.ok());
  EXPECT_NE(far.error().message.find("32768"), std::string::npos);
  EXPECT_TRUE(fs::is_empty(folder));
}

}  // namespace
}  // namespace stillmap
