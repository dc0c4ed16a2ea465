// SPDX-License-Identifier: Apache-2.0
#include "map/cloud.h"

#include <array>

namespace stillmap {

namespace {

/// What one point stands for: the sums over the occupied voxels of a cube.
struct Cube {
  int count = 0, x = 0, y = 0, z = 0, r = 0, g = 0, b = 0;

  void add(const Voxel& voxel, int vx, int vy, int vz) {
    ++count;
    x += vx;
    y += vy;
    z += vz;
    r += voxel.colour.r;
    g += voxel.colour.g;
    b += voxel.colour.b;
  }
  CloudPoint point(BlockCoordinates at, double voxel_m) const {
    const auto place = [&](std::int32_t block, int sum) {
      return static_cast<float>(
          (kBlockEdge * static_cast<double>(block) + static_cast<double>(sum) / count + 0.5) * voxel_m);
    };
    const auto colour = [&](int sum) { return static_cast<std::uint8_t>((sum + count / 2) / count); };
    return {place(at.x, x), place(at.y, y), place(at.z, z), colour(r), colour(g), colour(b), 255};
  }
};

/// The cubes of `edge` voxels of one block, x fastest.
using Cubes = std::array<Cube, kBlockVoxels>;

std::span<const Cube> cubes_of(std::span<const Voxel, kBlockVoxels> voxels, int edge, Cubes& cubes) {
  const int across = kBlockEdge / edge;
  const std::span<Cube> used = std::span(cubes).first(static_cast<std::size_t>(across * across * across));
  for (Cube& cube : used) cube = {};
  for (int v = 0; v < kBlockVoxels; ++v) {
    const Voxel& voxel = voxels[static_cast<std::size_t>(v)];
    if (!voxel.occupied()) continue;
    const int x = v % kBlockEdge, y = v / kBlockEdge % kBlockEdge, z = v / (kBlockEdge * kBlockEdge);
    used[static_cast<std::size_t>(x / edge + across * (y / edge + across * (z / edge)))].add(voxel, x, y, z);
  }
  return used;
}

/// How many points cubes of `edge` voxels make; all of them are written as far as `out` has room.
std::size_t write_cubes(const VoxelMap& map, int edge, std::span<CloudPoint> out) {
  Cubes cubes;
  std::size_t count = 0;
  for (int i = 0; i < map.blocks().size(); ++i) {
    const Block& block = map.blocks().block(i);
    if (block.occupied == 0) continue;
    for (const Cube& cube : cubes_of(map.blocks().voxels(i), edge, cubes)) {
      if (cube.count == 0) continue;
      if (count < out.size()) out[count] = cube.point(block.at, map.voxel_m());
      ++count;
    }
  }
  return count;
}

std::size_t write_some_blocks(const VoxelMap& map, std::size_t blocks, std::span<CloudPoint> out) {
  Cubes cubes;
  std::uint64_t seen = 0;  // times out.size(), it is beyond 32 bits
  std::size_t written = 0;
  for (int i = 0; i < map.blocks().size() && written < out.size(); ++i) {
    const Block& block = map.blocks().block(i);
    if (block.occupied == 0) continue;
    // The k-th block is due when k * out / blocks passes a whole number.
    if (seen++ * out.size() / blocks < written) continue;
    out[written++] = cubes_of(map.blocks().voxels(i), kBlockEdge, cubes)[0].point(block.at, map.voxel_m());
  }
  return written;
}

}  // namespace

std::size_t make_cloud(const VoxelMap& map, std::span<CloudPoint> out) {
  std::size_t needed = 0;
  for (int edge = 1; edge <= kBlockEdge; edge *= 2) {
    if (edge == 1 && map.occupied_voxels() > out.size()) continue;
    needed = write_cubes(map, edge, out);
    if (needed <= out.size()) return needed;
  }
  return write_some_blocks(map, needed, out);
}

}  // namespace stillmap
