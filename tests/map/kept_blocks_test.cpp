// SPDX-License-Identifier: Apache-2.0
#include "map/kept_blocks.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <memory>

namespace stillmap {
namespace {

constexpr double kVoxel_m = 0.04;
constexpr std::size_t kRoom = 6;

/// A block with one voxel of this evidence.
CopiedBlock block_at(BlockCoordinates at, std::size_t place, std::int8_t log_odds, std::uint64_t sequence = 1,
                     std::uint32_t keyframe = 0) {
  CopiedBlock b{};
  b.block.at = at;
  b.block.anchor_keyframe = keyframe;
  b.block.fused_sequence = b.block.changed_sequence = sequence;
  b.voxels[place].log_odds = log_odds;
  b.voxels[place].colour = {1, 2, 3};
  return b;
}

struct KeptBlocksTest : testing::Test {
  KeptBlocksTest() {
    char name[] = "/tmp/stillmap_kept_XXXXXX";
    folder = mkdtemp(name);
    EXPECT_TRUE(kept.open(folder / "m.stillmap").ok());
  }
  ~KeptBlocksTest() override { std::filesystem::remove_all(folder); }

  void evict(CopiedBlock block, std::uint32_t epoch = 0, std::optional<Pose> T_new_old = {}) {
    ASSERT_TRUE(kept.lane()->blocks.try_push({block, T_new_old, epoch}));
  }
  /// Keyframes 1 and 2: the second moves by this many blocks along x.
  void correct(std::uint32_t epoch, int blocks) {
    KeyframeMotions& motions = *kept.lane()->motions.room();
    motions = {};
    motions.epoch = epoch;
    ASSERT_TRUE(motions.keyframes.try_push_back({1, false, {}}));
    ASSERT_TRUE(motions.keyframes.try_push_back({2, true, {{}, {8 * kVoxel_m * blocks, 0, 0}}}));
    kept.lane()->motions.post();
  }
  /// As a map file has it.
  std::unique_ptr<BlockTable> saved() {
    const std::filesystem::path file = folder / "m.stillmap";
    MapFileWriter writer(file, {kVoxel_m, 0, false});
    kept.append_to(writer);
    EXPECT_TRUE(writer.finish().ok());
    Result<MapFile> read = read_map_file(file);
    EXPECT_TRUE(read.ok());
    map = std::move(read.value());
    return std::move(map.blocks);
  }
  static int log_odds(const BlockTable& table, BlockCoordinates at, std::size_t place) {
    const int index = table.find(at);
    return index == BlockTable::kNone ? -999 : table.voxels(index)[place].log_odds;
  }

  std::filesystem::path folder;
  Arena arena{4 << 20};
  KeptBlocks kept{arena, kRoom, kVoxel_m};
  MapFile map;
};

TEST_F(KeptBlocksTest, WhatWasEvictedIsInTheMapFileAndNothingIsLeftBeside) {
  evict(block_at({1, -2, 3}, 7, 100));
  evict(block_at({4, 5, 6}, 511, -20));
  kept.take_all();
  EXPECT_TRUE(std::filesystem::is_empty(folder)) << "a process that is killed leaves nothing";
  const auto table = saved();
  EXPECT_EQ(table->blocks_used(), 2u);
  EXPECT_EQ(log_odds(*table, {1, -2, 3}, 7), 100);
  EXPECT_EQ(log_odds(*table, {4, 5, 6}, 511), -20);
  EXPECT_EQ(table->voxels(table->find({1, -2, 3}))[7].colour.g, 2);
}

TEST_F(KeptBlocksTest, OfAPlaceMappedTwiceTheNewerLookCountsAndTheOlderFillsIn) {
  for (const int x : {0, 1}) {  // in either order
    CopiedBlock first = block_at({x, 0, 0}, 0, 100, 10), second = block_at({x, 0, 0}, 0, -64, 20);
    first.voxels[1].log_odds = 90;
    first.voxels[2].log_odds = 80;
    second.voxels[2].log_odds = Voxel::kHit;  // not enough to know
    evict(x == 0 ? first : second);
    evict(x == 0 ? second : first);
  }
  kept.take_all();
  EXPECT_EQ(kept.usage().high_water, 2u);
  const auto table = saved();
  for (const int x : {0, 1}) {
    EXPECT_EQ(log_odds(*table, {x, 0, 0}, 0), -64);
    EXPECT_EQ(log_odds(*table, {x, 0, 0}, 1), 90);
    EXPECT_EQ(log_odds(*table, {x, 0, 0}, 2), 80);
  }
}

TEST_F(KeptBlocksTest, WhatIsKeptMovesWithItsKeyframeAndWhatComesAfterwardsStays) {
  evict(block_at({0, 0, 0}, 5, 100, 1, 1));
  evict(block_at({10, 0, 0}, 5, 101, 1, 2));
  evict(block_at({33, 0, 0}, 5, -20, 1, 1));
  CopiedBlock over_it = block_at({30, 0, 0}, 5, 100, 9, 2);
  over_it.voxels[6].log_odds = 99;
  evict(over_it);
  correct(1, 3);
  evict(block_at({10, 0, 0}, 6, 102, 2, 2), 1);
  const Pose up{{}, {0, 8 * kVoxel_m, 0}};
  evict(block_at({20, 0, 0}, 5, 103, 2, 2), 1, up);  // still where it was before the correction
  kept.take_all();
  EXPECT_NE(kept.lane()->motions.room(), nullptr);
  const auto table = saved();
  EXPECT_EQ(table->blocks_used(), 5u);
  EXPECT_EQ(log_odds(*table, {0, 0, 0}, 5), 100);
  EXPECT_EQ(log_odds(*table, {13, 0, 0}, 5), 101);
  EXPECT_EQ(log_odds(*table, {10, 0, 0}, 6), 102);
  EXPECT_EQ(log_odds(*table, {20, 1, 0}, 5), 103);
  EXPECT_EQ(log_odds(*table, {33, 0, 0}, 5), -20) << "what moves fills in, and wipes nothing out";
  EXPECT_EQ(log_odds(*table, {33, 0, 0}, 6), 99);
  correct(2, -3);
  kept.take_all();
  const auto again = saved();
  EXPECT_EQ(log_odds(*again, {10, 0, 0}, 5), 101) << "moved back";
  EXPECT_EQ(log_odds(*again, {7, 0, 0}, 6), 102);
}

TEST_F(KeptBlocksTest, ABlockThatLandsAcrossOthersIsInAllOfThem) {
  CopiedBlock full = block_at({0, 0, 0}, 0, 100, 1, 2);
  for (Voxel& v : full.voxels) v.log_odds = 100;
  evict(full, 0, Pose{{}, {4 * kVoxel_m, 0, 0}});
  kept.take_all();
  const auto table = saved();
  EXPECT_EQ(table->blocks_used(), 2u);
  EXPECT_EQ(table->occupied_voxels(), 512u);
  EXPECT_EQ(log_odds(*table, {0, 0, 0}, 3), 0);
  EXPECT_EQ(log_odds(*table, {0, 0, 0}, 4), 100);
  EXPECT_EQ(log_odds(*table, {1, 0, 0}, 3), 100);
}

TEST_F(KeptBlocksTest, WhatHasNoRoomIsCountedAndSaid) {
  for (int x = 0; x < static_cast<int>(kRoom) + 2; ++x) evict(block_at({x, 0, 0}, 0, 100));
  kept.take_all();
  EXPECT_EQ(kept.usage().refused, 2u);
  EXPECT_EQ(kept.usage().high_water, kRoom);
  ASSERT_FALSE(kept.status().ok());
  EXPECT_NE(kept.status().error().message.find("map.kept_blocks"), std::string::npos);
  EXPECT_EQ(saved()->blocks_used(), kRoom);
}

TEST_F(KeptBlocksTest, AFullDiskCostsTheBlocksThatDoNotFit) {
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const rlimit small{2 * sizeof(CopiedBlock) + 100, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  for (int x = 0; x < 4; ++x) evict(block_at({x, 0, 0}, 0, 100));
  kept.take_all();
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  EXPECT_EQ(kept.usage().refused, 2u);
  EXPECT_NE(kept.status().error().message.find("free some space"), std::string::npos);
  const auto table = saved();
  EXPECT_EQ(table->blocks_used(), 2u);
  EXPECT_EQ(log_odds(*table, {1, 0, 0}, 0), 100);
}

TEST_F(KeptBlocksTest, AFolderThatTakesNoFileIsAnError) {
  Arena other(4 << 20);
  KeptBlocks nowhere(other, kRoom, kVoxel_m);
  const Status s = nowhere.open(folder / "missing" / "m.stillmap");
  ASSERT_FALSE(s.ok());
  EXPECT_EQ(s.error().exit_code, ExitCode::RunFailed);
  EXPECT_NE(s.error().message.find("missing/m.stillmap"), std::string::npos);
}

}  // namespace
}  // namespace stillmap
