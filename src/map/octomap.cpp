// SPDX-License-Identifier: Apache-2.0
#include "map/octomap.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <span>
#include <vector>

#include "core/whole_file.h"

namespace stillmap {

namespace {

constexpr int kDepth = 16;  // levels below the root
constexpr std::int32_t kReach = 1 << (kDepth - 1);

/// A leaf, by the way down to it: three bits a level, x lowest, the root's first.
struct Leaf {
  std::uint64_t way = 0;
  bool occupied = false;
};
using Leaves = std::span<const Leaf>;

/// Nothing beyond the tree.
std::optional<std::uint64_t> way_to(std::int32_t x, std::int32_t y, std::int32_t z) {
  std::uint64_t way = 0;
  for (const auto& [v, axis] : {std::pair(x, 0), {y, 1}, {z, 2}}) {
    if (v < -kReach || v >= kReach) return std::nullopt;
    for (int level = 0; level < kDepth; ++level)
      way |= static_cast<std::uint64_t>((v + kReach) >> level & 1) << (3 * level + axis);
  }
  return way;
}

/// In the order of the tree; nothing where one lies beyond it.
std::optional<std::vector<Leaf>> leaves_of(const BlockTable& blocks) {
  std::vector<Leaf> leaves;
  for (int i = 0; i < blocks.size(); ++i) {
    if (!blocks.found(i)) continue;
    const BlockCoordinates at = blocks.block(i).at;
    for (int v = 0; v < kBlockVoxels; ++v) {
      const Occupancy known = blocks.voxels(i)[static_cast<std::size_t>(v)].occupancy();
      if (known == Occupancy::Unknown) continue;
      const auto way =
          way_to(kBlockEdge * at.x + v % kBlockEdge, kBlockEdge * at.y + v / kBlockEdge % kBlockEdge,
                 kBlockEdge * at.z + v / (kBlockEdge * kBlockEdge));
      if (!way) return std::nullopt;
      leaves.push_back({*way, known == Occupancy::Occupied});
    }
  }
  std::ranges::sort(leaves, {}, &Leaf::way);
  return leaves;
}

std::size_t count_nodes(Leaves leaves) {
  std::size_t nodes = 1;
  for (int level = 0; level < kDepth; ++level) {
    std::uint64_t before = ~std::uint64_t{0};
    for (const Leaf& leaf : leaves) {
      nodes += leaf.way >> 3 * level != before;
      before = leaf.way >> 3 * level;
    }
  }
  return nodes;
}

/// An inner node whose children's ways differ in the bits of `level`, and all below it.
void write_node(Leaves leaves, int level, WholeFile& file) {
  std::array<Leaves, 8> children;
  std::uint16_t bits = 0;
  for (std::size_t child = 0; child < children.size(); ++child) {
    const auto last = std::ranges::partition_point(
        leaves, [&](const Leaf& leaf) { return (leaf.way >> 3 * level & 7) <= child; });
    const auto count = static_cast<std::size_t>(last - leaves.begin());
    children[child] = leaves.first(count);
    leaves = leaves.subspan(count);
    if (count == 0) continue;
    const int kind = level > 0 ? 3 : children[child].front().occupied ? 2 : 1;
    bits = static_cast<std::uint16_t>(bits | kind << 2 * child);
  }
  file.append(&bits, sizeof(bits));  // little endian: the first four children first
  if (level == 0) return;
  for (const Leaves child : children) {
    if (!child.empty()) write_node(child, level - 1, file);
  }
}

}  // namespace

Status write_octomap(const BlockTable& blocks, double voxel_m, const std::string& path) {
  const std::optional<std::vector<Leaf>> leaves = leaves_of(blocks);
  if (!leaves)
    return Error{ExitCode::WrongConfig,
                 "the map reaches farther than the 32768 voxels that an OctoMap tree has each way"};
  if (leaves->empty()) return Error{ExitCode::WrongConfig, "the map is empty; there is nothing to export"};
  std::array<char, 256> header{};
  const int length = std::snprintf(header.data(), header.size(),
                                   "# Octomap OcTree binary file\n# (feel free to add / change comments, but "
                                   "leave the first line as it is!)\n#\n"
                                   "id OcTree\nsize %zu\nres %.9g\ndata\n",
                                   count_nodes(*leaves), voxel_m);
  WholeFile file(path);
  file.append(header.data(), static_cast<std::size_t>(length));
  write_node(*leaves, kDepth - 1, file);
  return file.finish();
}

}  // namespace stillmap
