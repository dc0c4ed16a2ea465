// SPDX-License-Identifier: Apache-2.0
#include "map/block_table.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <tuple>

namespace stillmap {
namespace {

constexpr std::size_t kBlocks = 64;

struct TableUnderTest {
  Arena arena{4 << 20};
  BlockTable table{arena, kBlocks};
};

TEST(BlockTable, finds_what_was_added_and_nothing_else) {
  TableUnderTest t;
  t.table.begin_frame({});
  const int a = t.table.find_or_add({-1, 2, -3}, 7);
  EXPECT_EQ(t.table.find({-1, 2, -3}), a);
  EXPECT_EQ(t.table.find_or_add({-1, 2, -3}, 9), a);
  EXPECT_EQ(t.table.block(a).anchor_keyframe, 7u);
  EXPECT_EQ(t.table.find({1, 2, -3}), BlockTable::kNone);
  EXPECT_EQ(t.table.blocks_used(), 1u);
}

TEST(BlockTable, gives_up_the_farthest_when_full) {
  TableUnderTest t;
  t.table.begin_frame({});
  for (int x = 0; x < static_cast<int>(kBlocks); ++x)
    ASSERT_NE(t.table.find_or_add({x, 0, 0}, 0), BlockTable::kNone);
  t.table.begin_frame({-5, 0, 0});
  EXPECT_NE(t.table.find_or_add({-5, 0, 0}, 0), BlockTable::kNone);
  EXPECT_NE(t.table.find_or_add({-5, 1, 0}, 0), BlockTable::kNone);
  EXPECT_EQ(t.table.evicted(), 2u);
  for (int x = 0; x < static_cast<int>(kBlocks); ++x) EXPECT_EQ(t.table.find({x, 0, 0}) >= 0, x < 62) << x;
}

TEST(BlockTable, never_gives_up_a_nearer_block_for_a_farther_one) {
  TableUnderTest t;
  t.table.begin_frame({});
  for (int x = 0; x < static_cast<int>(kBlocks); ++x) (void)t.table.find_or_add({x, 0, 0}, 0);
  t.table.begin_frame({});
  EXPECT_EQ(t.table.find_or_add({0, 0, 500}, 0), BlockTable::kNone);
  EXPECT_EQ(t.table.evicted(), 0u);
  EXPECT_EQ(t.table.usage().refused, 1u);
  EXPECT_EQ(t.table.blocks_used(), kBlocks);
}

TEST(BlockTable, one_far_block_that_asks_first_does_not_shut_out_the_near_ones) {
  TableUnderTest t;
  t.table.begin_frame({});
  for (int x = 0; x < static_cast<int>(kBlocks); ++x) (void)t.table.find_or_add({x, 0, 0}, 0);
  t.table.begin_frame({});
  EXPECT_EQ(t.table.find_or_add({0, 70, 0}, 0), BlockTable::kNone);
  EXPECT_NE(t.table.find_or_add({0, 1, 0}, 0), BlockTable::kNone);
}

TEST(BlockTable, evicts_a_sixteenth_per_frame_at_most) {
  TableUnderTest t;
  t.table.begin_frame({});
  for (int x = 0; x < static_cast<int>(kBlocks); ++x) (void)t.table.find_or_add({x, 0, 0}, 0);
  t.table.begin_frame({});
  for (int i = 0; i < 4; ++i) EXPECT_NE(t.table.find_or_add({0, 1, i}, 0), BlockTable::kNone);
  EXPECT_EQ(t.table.find_or_add({0, 2, 0}, 0), BlockTable::kNone);
  t.table.begin_frame({});
  EXPECT_NE(t.table.find_or_add({0, 2, 0}, 0), BlockTable::kNone);
}

TEST(BlockTable, a_new_block_where_a_far_one_was_released_does_not_give_way_in_its_stead) {
  TableUnderTest t;
  t.table.begin_frame({});
  for (int x = 0; x < static_cast<int>(kBlocks); ++x) (void)t.table.find_or_add({x, 0, 0}, 0);
  t.table.begin_frame({});
  EXPECT_NE(t.table.find_or_add({0, 1, 0}, 0), BlockTable::kNone);
  t.table.release(t.table.find({62, 0, 0}));
  EXPECT_NE(t.table.find_or_add({0, 2, 0}, 0), BlockTable::kNone);
  EXPECT_NE(t.table.find_or_add({0, 3, 0}, 0), BlockTable::kNone);
  EXPECT_NE(t.table.find({0, 2, 0}), BlockTable::kNone);
  EXPECT_EQ(t.table.find({61, 0, 0}), BlockTable::kNone);
}

TEST(BlockTable, a_block_gives_way_only_while_there_is_room_where_it_is_kept) {
  Arena arena{24 << 20};
  EvictedBlocks& lane = arena.take<EvictedBlocks>("lane", 1).front();
  constexpr std::size_t kMany = 16 * (decltype(lane.blocks)::capacity() + 4);
  BlockTable table{arena, kMany, nullptr, &lane};
  table.begin_frame({});
  for (int x = 0; x < static_cast<int>(kMany); ++x) {
    const int index = table.find_or_add({x, 0, 0}, 5);
    if (x != static_cast<int>(kMany) - 2)
      table.voxels(index)[7].log_odds = -13;  // one of which nothing is known
  }
  table.begin_epoch(3);
  table.begin_frame({});
  for (int x = 0; x < static_cast<int>(lane.blocks.capacity()) + 1; ++x)
    ASSERT_NE(table.find_or_add({x, 1, 0}, 0), BlockTable::kNone);
  EXPECT_EQ(table.find_or_add({0, 2, 0}, 0), BlockTable::kNone);
  EXPECT_EQ(table.evicted(), lane.blocks.capacity() + 1);
  const EvictedBlock* first = lane.blocks.front();
  EXPECT_EQ(first->copy.block.at, (BlockCoordinates{static_cast<int>(kMany) - 1, 0, 0}));
  EXPECT_EQ(first->copy.block.anchor_keyframe, 5u);
  EXPECT_EQ(first->copy.voxels[7].log_odds, -13);
  EXPECT_EQ(first->epoch, 3u);
  EXPECT_FALSE(first->T_new_old);
  (void)lane.blocks.try_pop();
  EXPECT_NE(table.find_or_add({0, 2, 0}, 0), BlockTable::kNone);
}

TEST(BlockTable, a_reused_block_starts_empty) {
  TableUnderTest t;
  t.table.begin_frame({});
  for (int x = 0; x < static_cast<int>(kBlocks); ++x) {
    const int i = t.table.find_or_add({x, 0, 0}, 1);
    for (Voxel& v : t.table.voxels(i)) v.log_odds = Voxel::kMax;
    t.table.note_fused(i, 3, true, kBlockVoxels);
  }
  EXPECT_EQ(t.table.occupied_voxels(), kBlocks * kBlockVoxels);
  t.table.begin_frame({});
  const int i = t.table.find_or_add({0, 1, 0}, 2);
  EXPECT_EQ(t.table.occupied_voxels(), (kBlocks - 1) * kBlockVoxels);
  EXPECT_EQ(t.table.block(i).anchor_keyframe, 2u);
  EXPECT_EQ(t.table.block(i).changed_sequence, 0u);
  for (const Voxel& v : t.table.voxels(i)) ASSERT_EQ(v.log_odds, 0);
}

TEST(BlockTable, stays_consistent_under_a_long_random_walk) {
  TableUnderTest t;
  std::mt19937 random(1);
  BlockCoordinates camera;
  for (int frame = 0; frame < 3000; ++frame) {
    camera.x += static_cast<int>(random() % 3) - 1;
    camera.y += static_cast<int>(random() % 3) - 1;
    camera.z += static_cast<int>(random() % 3);
    t.table.begin_frame(camera);
    for (int i = 0; i < 6; ++i) {
      const auto off = [&] { return static_cast<int>(random() % 7) - 3; };
      (void)t.table.find_or_add({camera.x + off(), camera.y + off(), camera.z + off()}, 0);
    }
    ASSERT_LE(t.table.blocks_used(), kBlocks);
    for (int i = 0; i < t.table.size(); ++i) {
      ASSERT_EQ(t.table.find(t.table.block(i).at), i) << "frame " << frame;
    }
  }
  EXPECT_GT(t.table.evicted(), 1000u);
}

TEST(BlockTable, extreme_coordinates_are_as_good_as_any) {
  TableUnderTest t;
  t.table.begin_frame({});
  constexpr int kFar = 25'000'000;  // the map's limit at its smallest voxels
  const int a = t.table.find_or_add({kFar, -kFar, kFar}, 0), b = t.table.find_or_add({-kFar, kFar, -kFar}, 0);
  EXPECT_NE(a, b);
  EXPECT_EQ(t.table.find({kFar, -kFar, kFar}), a);
}

TEST(BlockTable, a_planning_arena_is_asked_for_the_same) {
  Arena plan;
  const BlockTable planned(plan, kBlocks);
  TableUnderTest t;
  EXPECT_EQ(plan.bytes_planned(), t.arena.bytes_planned());
  EXPECT_EQ(planned.find({}), BlockTable::kNone);
}

}  // namespace
}  // namespace stillmap
