// SPDX-License-Identifier: Apache-2.0
#include "runtime/block_feed.h"

namespace stillmap {

namespace {

StreamBlock stream_block(const BlockTable& table, int slot) {
  static_assert(StreamBlock::kVoxels == kBlockVoxels);
  const Block& block = table.block(slot);
  StreamBlock out{
      .slot = static_cast<std::uint32_t>(slot), .x = block.at.x, .y = block.at.y, .z = block.at.z};
  const std::span<const Voxel, kBlockVoxels> voxels = table.voxels(slot);
  for (std::size_t v = 0; v < voxels.size(); ++v) {
    if (!voxels[v].occupied()) continue;
    out.occupied[v / 8] = static_cast<std::uint8_t>(out.occupied[v / 8] | 1 << v % 8);
    const Bgr& colour = voxels[v].colour;
    std::uint8_t* to = &out.colours[3 * out.count++];
    to[0] = colour.r;
    to[1] = colour.g;
    to[2] = colour.b;
  }
  return out;
}

void answer(const VoxelMap& map, Nanoseconds stamp_ns, stream::BlockExchange& exchange) {
  const BlockTable& table = map.blocks();
  const auto [since, cursor] = exchange.request();
  int slot = static_cast<int>(cursor);
  for (; slot < table.size(); ++slot) {
    if (table.block(slot).version <= since) continue;
    // A client that knows nothing yet need not know of what is empty.
    if (since == 0 && table.block(slot).occupied == 0) continue;
    if (!exchange.add(stream_block(table, slot))) break;
  }
  exchange.finish({.next = static_cast<std::uint32_t>(slot),
                   .complete = slot >= table.size(),
                   .version = table.changes(),
                   .epoch = map.settled_epoch(),
                   .voxel_m = map.voxel_m(),
                   .stamp_ns = stamp_ns});
}

}  // namespace

void feed_blocks(const VoxelMap& map, Nanoseconds stamp_ns, StreamServer& server) {
  bool answered = false;
  for (stream::BlockExchange& exchange : server.block_exchanges()) {
    if (!exchange.begin()) continue;
    answer(map, stamp_ns, exchange);
    answered = true;
  }
  if (answered) server.blocks_answered();
}

}  // namespace stillmap
