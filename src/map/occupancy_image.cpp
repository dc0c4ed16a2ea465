// SPDX-License-Identifier: Apache-2.0
#include "map/occupancy_image.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>

#include "core/whole_file.h"

namespace stillmap {

namespace {

struct BlockBounds {
  std::int32_t x0 = std::numeric_limits<std::int32_t>::max(), y0 = x0;
  std::int32_t x1 = std::numeric_limits<std::int32_t>::min(), y1 = x1;
  void add(BlockCoordinates at) {
    x0 = std::min(x0, at.x);
    y0 = std::min(y0, at.y);
    x1 = std::max(x1, at.x);
    y1 = std::max(y1, at.y);
  }
};

Error wrong(const std::string& message) {
  return {ExitCode::WrongConfig, message};
}

/// A cell's column so far, with one more voxel.
Occupancy merged(Occupancy column, Occupancy voxel) {
  if (column == Occupancy::Occupied || voxel == Occupancy::Unknown) return column;
  return voxel;
}

}  // namespace

Result<OccupancyImage> occupancy_image(const MapFile& map, double from_m, double to_m) {
  if (!map.facts.z_is_up)
    return wrong(
        "the map does not know which way is up, so it has no floor plan; map with camera.T_base_camera set");
  const double edge_m = map.facts.voxel_m;
  const auto in_band = [&](std::int32_t block_z, int z) {
    const double centre_m = (kBlockEdge * static_cast<double>(block_z) + z + 0.5) * edge_m;
    return centre_m >= from_m && centre_m <= to_m;
  };
  const BlockTable& blocks = *map.blocks;
  BlockBounds bounds;
  for (int i = 0; i < blocks.size(); ++i) {
    for (int z = 0; z < kBlockEdge; ++z) {
      if (in_band(blocks.block(i).at.z, z)) bounds.add(blocks.block(i).at);
    }
  }
  if (bounds.x0 > bounds.x1) return wrong("nothing is mapped between the heights; widen --from and --to");
  const std::int64_t columns = std::int64_t{bounds.x1} - bounds.x0 + 1,
                     rows = std::int64_t{bounds.y1} - bounds.y0 + 1;
  // Two blocks that lie far apart are a small file.
  if (columns > 4096 || rows > 4096 || columns * rows > 1 << 20)
    return wrong(
        "the map is wider than 32768 voxels, or covers more than 67 million; it has no floor plan of one "
        "picture");

  OccupancyImage image;
  image.width = static_cast<int>(columns) * kBlockEdge;
  image.height = static_cast<int>(rows) * kBlockEdge;
  image.origin_x_m = kBlockEdge * static_cast<double>(bounds.x0) * edge_m;
  image.origin_y_m = kBlockEdge * static_cast<double>(bounds.y0) * edge_m;
  image.cells.assign(static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height),
                     Occupancy::Unknown);
  for (int i = 0; i < blocks.size(); ++i) {
    const BlockCoordinates at = blocks.block(i).at;
    for (int v = 0; v < kBlockVoxels; ++v) {
      if (!in_band(at.z, v / (kBlockEdge * kBlockEdge))) continue;
      const int x = (at.x - bounds.x0) * kBlockEdge + v % kBlockEdge;
      const int y = (at.y - bounds.y0) * kBlockEdge + v / kBlockEdge % kBlockEdge;
      Occupancy& cell = image.cells[static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                                    static_cast<std::size_t>(x)];
      cell = merged(cell, blocks.voxels(i)[static_cast<std::size_t>(v)].occupancy());
    }
  }
  return image;
}

Status write_occupancy_image(const OccupancyImage& image, double voxel_m, const std::string& path) {
  const auto grey = [](Occupancy cell) -> char {
    if (cell == Occupancy::Unknown) return static_cast<char>(205);
    return static_cast<char>(cell == Occupancy::Occupied ? 0 : 254);
  };
  WholeFile picture(path);
  const std::string header =
      "P5\n" + std::to_string(image.width) + " " + std::to_string(image.height) + "\n255\n";
  picture.append(header.data(), header.size());
  for (int y = image.height - 1; y >= 0; --y) {
    for (int x = 0; x < image.width; ++x) {
      const char g = grey(image.cells[static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                                      static_cast<std::size_t>(x)]);
      picture.append(&g, 1);
    }
  }
  if (Status s = picture.finish(); !s.ok()) return s;

  std::array<char, 256> numbers{};
  const int length = std::snprintf(numbers.data(), numbers.size(),
                                   "resolution: %.6g\norigin: [%.6f, %.6f, 0.0]\nnegate: 0\n"
                                   "occupied_thresh: 0.65\nfree_thresh: 0.196\n",
                                   voxel_m, image.origin_x_m, image.origin_y_m);
  const std::filesystem::path name(path);
  const std::string text = "image: " + name.filename().string() + "\n" +
                           std::string(numbers.data(), static_cast<std::size_t>(length));
  WholeFile facts(std::filesystem::path(path).replace_extension(".yaml"));
  facts.append(text.data(), text.size());
  return facts.finish();
}

}  // namespace stillmap
