// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/status.h"
#include "map/map_file.h"

namespace stillmap {

/// The map from above, between two heights of its frame (z up): a column is occupied where a voxel in it is,
/// free where one is free and none occupied, else unknown.
struct OccupancyImage {
  int width = 0, height = 0;              ///< cells of one voxel
  double origin_x_m = 0, origin_y_m = 0;  ///< the lower left cell's outer corner, in the map
  std::vector<Occupancy> cells;           ///< row-major from the lowest y
};

/// Whole blocks around the columns that are known. The error (WrongConfig): the map's up is not known, or
/// there is nothing between the heights.
Result<OccupancyImage> occupancy_image(const MapFile& map, double from_m, double to_m);

/// `path` (.pgm) and, beside it, .yaml, in the convention of ROS's map_server: 0 occupied, 254 free, 205
/// unknown, first row = largest y.
Status write_occupancy_image(const OccupancyImage& image, double voxel_m, const std::string& path);

}  // namespace stillmap
