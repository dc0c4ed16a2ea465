// SPDX-License-Identifier: Apache-2.0
#include "runtime/block_feed.h"

#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <set>

#include "tests/runtime/wall_scene.h"

namespace stillmap {
namespace {

using test::WallScene;

/// A map of the wall scene with room for few blocks, and a server whose first client's wishes the test makes.
struct BlockFeedTest : testing::Test {
  explicit BlockFeedTest(int blocks = 4000) : config(config_with(blocks)) {}
  static Config config_with(int blocks) {
    Config config = WallScene::config();
    config.map.capacity_voxels = blocks * kBlockVoxels;
    config.stream.listen = "127.0.0.1:0";
    return config;
  }
  void fuse(int index, Vec3 moved = {}) {
    FrameHandle frame = pool.acquire();
    scene.draw(index, frame.writable());
    Pose T = WallScene::T_first_camera(index);
    T.t = T.t + moved;
    ASSERT_EQ(map.fuse({.colour = frame->colour,
                        .depth = frame->depth,
                        .mask = mask,
                        .T_map_camera_depth = T,
                        .T_map_camera_colour = T,
                        .sequence = ++sequence}),
              FuseOutcome::Fused);
  }
  /// A whole pass: every answer until it is complete. Keeps how often each slot came, and the version.
  std::map<std::uint32_t, int> pass(std::uint64_t since) {
    std::map<std::uint32_t, int> slots;
    stream::BlockExchange& exchange = server.block_exchanges()[0];
    stream::BlockRequest request{since, 0};
    std::uint64_t begun = 0;
    do {
      exchange.ask(request);
      feed_blocks(map, 7, server);
      EXPECT_TRUE(exchange.answered());
      if (request.cursor == 0) begun = exchange.answer().version;
      EXPECT_TRUE(exchange.answer().complete || exchange.answer().next > request.cursor)
          << "each answer goes on";
      request.cursor = exchange.answer().next;
      for (std::span<const std::uint8_t> rest = exchange.blocks(); !rest.empty();) {
        // Tag, two bytes of length at most, then the slot as the first field unless it is 0.
        std::size_t at = 1, length = rest[at] & 127;
        if (rest[at++] > 127) length |= static_cast<std::size_t>(rest[at++]) << 7;
        std::uint32_t slot = 0;
        if (rest[at] == 8)
          slot = rest[at + 1] > 127 ? (rest[at + 1] & 127U) | rest[at + 2] * 128U : rest[at + 1];
        ++slots[slot];
        rest = rest.subspan(at + length);
      }
    } while (!exchange.answer().complete);
    version = begun;
    return slots;
  }

  WallScene scene;
  Config config;
  Arena arena{64 << 20};
  FramePool pool{arena, 2, WallScene::kWidth, WallScene::kHeight};
  RayTable rays{arena, config.camera};
  VoxelMap map{arena, config.map, config.camera, rays};
  DynamicMask mask;
  StreamServer server{config, arena};
  std::uint64_t sequence = 0, version = 0;
};

TEST_F(BlockFeedTest, TheSnapshotHasEachOccupiedBlockOnceAndAPassAfterItNothing) {
  for (int i = 0; i < 3; ++i) fuse(0);
  std::size_t occupied = 0;
  for (int i = 0; i < map.blocks().size(); ++i) occupied += map.blocks().block(i).occupied > 0;
  ASSERT_GT(occupied, 50U);
  const auto slots = pass(0);
  EXPECT_EQ(slots.size(), occupied);
  for (const auto& [slot, count] : slots) EXPECT_EQ(count, 1) << slot;
  EXPECT_TRUE(pass(version).empty());
}

struct SmallMapTest : BlockFeedTest {
  SmallMapTest() : BlockFeedTest(40) {}
};

TEST_F(SmallMapTest, AnEvictedBlocksSlotIsToldWhateverItHoldsNow) {
  for (int i = 0; i < 3; ++i) fuse(0);
  const auto before = pass(0);
  std::map<std::uint32_t, BlockCoordinates> at;
  for (const auto& [slot, count] : before) at[slot] = map.blocks().block(static_cast<int>(slot)).at;
  fuse(0, {5, 0, 0});  // once: what is new is not yet occupied, but it has taken the place of what was
  ASSERT_GT(map.blocks_evicted(), 0U);
  const auto after = pass(version);
  for (const auto& [slot, place] : at) {
    const bool taken = !(map.blocks().block(static_cast<int>(slot)).at == place);
    EXPECT_TRUE(!taken || after.count(slot) == 1U) << slot;
  }
}

TEST_F(BlockFeedTest, ACorrectionsNewAndRemovedBlocksAreTold) {
  for (int i = 0; i < 3; ++i) fuse(0);
  std::set<std::uint32_t> shown;
  for (const auto& [slot, count] : pass(0)) shown.insert(slot);
  const auto correction = std::make_unique<Correction>();
  correction->epoch = 1;
  ASSERT_TRUE(correction->keyframes.try_push_back({0, {{}, {0, 0, 0.5}}}));
  map.correct(*correction);
  std::size_t removed = 0;
  while (map.correcting()) {
    map.continue_correction();
    // A client that looks in now and then has to end with what the map ends with.
    for (const auto& [slot, count] : pass(version)) {
      const Block& block = map.blocks().block(static_cast<int>(slot));
      removed += block.state == BlockState::Empty;
      block.occupied > 0 ? static_cast<void>(shown.insert(slot)) : static_cast<void>(shown.erase(slot));
    }
  }
  EXPECT_GT(removed, 0U);
  std::set<std::uint32_t> occupied;
  for (int i = 0; i < map.blocks().size(); ++i) {
    if (map.blocks().block(i).occupied > 0) occupied.insert(static_cast<std::uint32_t>(i));
  }
  EXPECT_GT(occupied.size(), 50U);
  EXPECT_EQ(shown, occupied);
  EXPECT_TRUE(pass(version).empty());
}

}  // namespace
}  // namespace stillmap
