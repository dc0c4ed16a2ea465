// SPDX-License-Identifier: Apache-2.0
#include "map/ply.h"

#include <array>
#include <bit>
#include <cstring>

namespace stillmap {

namespace {

static_assert(std::endian::native == std::endian::little, "the PLY is written as it lies in memory");

constexpr std::size_t kVertexBytes = 3 * sizeof(float) + 3;

}  // namespace

Status write_ply(const BlockTable& blocks, double voxel_m, const std::string& path, Nanoseconds timeout_ns,
                 EarlierFile* earlier) {
  WholeFile file(path, timeout_ns, earlier);
  const std::string header =
      "ply\nformat binary_little_endian 1.0\ncomment Stillmap voxel centres in m, map frame\nelement "
      "vertex " +
      std::to_string(blocks.occupied_voxels()) +
      "\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
  file.append(header.data(), header.size());
  for_each_occupied(blocks, voxel_m, [&file](const OccupiedVoxel& v) {
    const std::array<float, 3> place{v.x, v.y, v.z};
    std::array<char, kVertexBytes> vertex;
    std::memcpy(vertex.data(), place.data(), sizeof(place));
    vertex[12] = static_cast<char>(v.colour.r);
    vertex[13] = static_cast<char>(v.colour.g);
    vertex[14] = static_cast<char>(v.colour.b);
    file.append(vertex.data(), vertex.size());
  });
  return file.finish();
}

}  // namespace stillmap
