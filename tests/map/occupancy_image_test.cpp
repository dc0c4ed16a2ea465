// SPDX-License-Identifier: Apache-2.0
#include "map/occupancy_image.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

namespace stillmap {
namespace {

namespace fs = std::filesystem;

/// Two blocks side by side: voxel (0, 0) occupied at height 3, (9, 2) free, (1, 0) free below and occupied
/// above, (2, 0) occupied at height 7 alone.
MapFile two_blocks() {
  MapFile map;
  map.facts = {0.5, 0, true};
  map.memory = std::make_unique<Arena>(1 << 20);
  map.blocks = std::make_unique<BlockTable>(*map.memory, 4);
  const auto set = [&](BlockCoordinates at, int x, int y, int z, int log_odds) {
    const int index = map.blocks->find_or_add(at, 0);
    map.blocks->voxels(index)[static_cast<std::size_t>(x + 8 * y + 64 * z)].log_odds =
        static_cast<std::int8_t>(log_odds);
  };
  set({-1, 2, 0}, 0, 0, 3, Voxel::kMax);
  set({-1, 2, 0}, 1, 0, 1, Voxel::kMin);
  set({-1, 2, 0}, 1, 0, 2, Voxel::kMax);
  set({-1, 2, 0}, 2, 0, 7, Voxel::kMax);
  set({0, 2, 0}, 1, 2, 2, Voxel::kMin);
  return map;
}

TEST(OccupancyImage, AColumnIsOccupiedBeforeItIsFreeBeforeItIsUnknown) {
  const MapFile map = two_blocks();
  const Result<OccupancyImage> made = occupancy_image(map, 0.0, 3.5);  // the voxels 0 to 6
  ASSERT_TRUE(made.ok()) << made.error().message;
  const OccupancyImage& image = made.value();
  EXPECT_EQ(image.width, 16);
  EXPECT_EQ(image.height, 8);
  EXPECT_EQ(image.origin_x_m, -4);
  EXPECT_EQ(image.origin_y_m, 8);
  EXPECT_EQ(image.cells[0], Occupancy::Occupied);
  EXPECT_EQ(image.cells[1], Occupancy::Occupied);
  EXPECT_EQ(image.cells[2], Occupancy::Unknown) << "too high to count";
  EXPECT_EQ(image.cells[2 * 16 + 9], Occupancy::Free);
}

TEST(OccupancyImage, TwoBlocksFarApartAreRefusedBeforeThePictureIsMade) {
  for (const BlockCoordinates far : {BlockCoordinates{5000, 0, 0}, BlockCoordinates{2000, 2000, 0}}) {
    MapFile map = two_blocks();
    map.blocks->find_or_add(far, 0);
    const Result<OccupancyImage> made = occupancy_image(map, 0.0, 3.5);
    ASSERT_FALSE(made.ok()) << far.x;
    EXPECT_NE(made.error().message.find("no floor plan of one picture"), std::string::npos);
  }
}

TEST(OccupancyImage, TheFilesFollowMapServer) {
  const fs::path folder = fs::temp_directory_path() / ("stillmap_occupancy_" + std::to_string(getpid()));
  fs::create_directories(folder);
  const MapFile map = two_blocks();
  ASSERT_TRUE(write_occupancy_image(occupancy_image(map, 0, 3.5).value(), 0.5, folder / "plan.pgm").ok());
  const auto read = [&](const char* name) {
    std::ifstream file(folder / name, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  const std::string picture = read("plan.pgm"), head = "P5\n16 8\n255\n";
  ASSERT_EQ(picture.substr(0, head.size()), head);
  const std::string pixels = picture.substr(head.size());
  ASSERT_EQ(pixels.size(), 16u * 8u);
  EXPECT_EQ(pixels[7 * 16], '\0') << "the lowest y is the last row";
  EXPECT_EQ(static_cast<unsigned char>(pixels[5 * 16 + 9]), 254);
  EXPECT_EQ(static_cast<unsigned char>(pixels[0]), 205);
  EXPECT_EQ(read("plan.yaml"),
            "image: plan.pgm\nresolution: 0.5\norigin: [-4.000000, 8.000000, 0.0]\nnegate: 0\n"
            "occupied_thresh: 0.65\nfree_thresh: 0.196\n");
  fs::remove_all(folder);
}

TEST(OccupancyImage, WithoutUpOrWithoutContentItIsRefusedWithTheMend) {
  MapFile map = two_blocks();
  EXPECT_NE(occupancy_image(map, 50, 60).error().message.find("widen --from and --to"), std::string::npos);
  map.facts.z_is_up = false;
  const Result<OccupancyImage> made = occupancy_image(map, 0, 3.5);
  ASSERT_FALSE(made.ok());
  EXPECT_NE(made.error().message.find("camera.T_base_camera"), std::string::npos);
}

}  // namespace
}  // namespace stillmap
