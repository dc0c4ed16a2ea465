// SPDX-License-Identifier: Apache-2.0
#include "track/local_map.h"

#include <gtest/gtest.h>

#include <set>

#include "scene.h"

namespace stillmap {
namespace {

MapPoint found_at(std::uint64_t sequence) {
  MapPoint p;
  p.last_found_sequence = sequence;
  return p;
}

Keyframe& add_keyframe_at(LocalMap& map, double x_m, double yaw_rad = 0) {
  Keyframe& k = map.add_keyframe();
  k.T_odom_camera = {exp_so3({0, yaw_rad, 0}), {x_m, 0, 0}};
  return k;
}

TEST(LocalMap, PointsComeBackByReference) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 100);
  MapPoint p = found_at(5);
  p.p_odom = {1, 2, 3};
  p.id = 999;  // the map gives ids, whatever the caller wrote
  const PointRef ref = map.add_point(p);
  MapPoint* found = map.find(ref);
  ASSERT_NE(found, nullptr);
  EXPECT_EQ(found->p_odom.y, 2);
  EXPECT_TRUE(found->alive);
  EXPECT_EQ(found->id, ref.id);
  EXPECT_NE(ref.id, 999u);
  EXPECT_EQ(map.find({}), nullptr);
}

TEST(LocalMap, AStaleReferenceFindsNothing) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 100);
  const PointRef old = map.add_point({});
  map.remove_point(static_cast<std::size_t>(old.slot));
  EXPECT_EQ(map.find(old), nullptr);
  const PointRef fresh = map.add_point({});
  ASSERT_EQ(fresh.slot, old.slot) << "the test wants the slot used again";
  EXPECT_NE(fresh.id, old.id);
  EXPECT_EQ(map.find(old), nullptr);
  EXPECT_NE(map.find(fresh), nullptr);
}

TEST(LocalMap, EverySlotIsUsedOnce) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 100);
  std::set<std::int32_t> slots;
  for (int i = 0; i < 100; ++i) slots.insert(map.add_point(found_at(1)).slot);
  EXPECT_EQ(slots.size(), 100u);
  EXPECT_EQ(*slots.begin(), 0);
  EXPECT_EQ(*slots.rbegin(), 99);
}

TEST(LocalMap, AFullMapGivesUpThePointFoundLongestAgo) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 50);
  std::vector<PointRef> refs;
  for (std::uint64_t i = 0; i < 50; ++i) refs.push_back(map.add_point(found_at(i == 17 ? 3 : 100 + i)));
  EXPECT_EQ(map.point_usage().refused, 0u);
  const PointRef extra = map.add_point(found_at(200));
  EXPECT_EQ(extra.slot, refs[17].slot);
  EXPECT_EQ(map.find(refs[17]), nullptr);
  const PoolUsage usage = map.point_usage();
  EXPECT_EQ(usage.capacity, 50u);
  EXPECT_EQ(usage.high_water, 50u);
  EXPECT_EQ(usage.refused, 1u);
  // The next to go is the next oldest, not the newcomer.
  EXPECT_EQ(map.add_point(found_at(201)).slot, refs[0].slot);
}

TEST(LocalMap, HighWaterStays) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 50);
  for (int i = 0; i < 30; ++i) static_cast<void>(map.add_point({}));
  for (std::size_t i = 0; i < 30; ++i) map.remove_point(i);
  static_cast<void>(map.add_point({}));
  EXPECT_EQ(map.point_usage().high_water, 30u);
}

TEST(LocalMapDeathTest, RemovingTwiceIsABug) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 50);
  const auto slot = static_cast<std::size_t>(map.add_point({}).slot);
  map.remove_point(slot);
  EXPECT_DEATH(map.remove_point(slot), "alive");
}

TEST(LocalMap, ClearForgetsAllButTheIds) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 50);
  const PointRef before = map.add_point({});
  const std::uint32_t keyframe_before = map.add_keyframe().id;
  map.clear();
  EXPECT_EQ(map.find(before), nullptr);
  EXPECT_EQ(map.newest_keyframe(), nullptr);
  for (int i = 0; i < 50; ++i) EXPECT_NE(map.add_point({}).id, before.id);
  EXPECT_EQ(map.find(before), nullptr);
  EXPECT_EQ(map.point_usage().refused, 0u);
  EXPECT_GT(map.add_keyframe().id, keyframe_before);
}

TEST(LocalMap, IdsOfPointsWrapAndAreNeverNone) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 50);
  const PointRef old = map.add_point({});
  std::uint32_t last = old.id, wraps = 0;
  for (int i = 0; i < 20'000; ++i) {
    map.begin_segment();
    const PointRef ref = map.add_point({});
    wraps += ref.id < last;
    last = ref.id;
    ASSERT_NE(ref.id, 0u);
    ASSERT_NE(map.find(ref), nullptr);
    EXPECT_TRUE(map.in_segment(*map.find(ref)));
    if (const MapPoint* first = map.find(old)) {
      EXPECT_FALSE(map.in_segment(*first));
    }
    map.remove_point(static_cast<std::size_t>(ref.slot));
    ASSERT_EQ(map.find(ref), nullptr);
  }
  EXPECT_EQ(wraps, 1u);
}

TEST(LocalMap, SegmentsAreApartUntilTheyAreJoined) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 50);
  PointRef points[3];
  Keyframe* keyframes[3];
  for (int i = 0; i < 3; ++i) {
    map.begin_segment();
    points[i] = map.add_point({});
    keyframes[i] = &map.add_keyframe();
    EXPECT_EQ(keyframes[i]->segment, map.segment());
    for (int j = 0; j <= i; ++j) EXPECT_EQ(map.in_segment(*map.find(points[j])), j == i);
  }
  map.enter_segment(keyframes[0]->segment);
  EXPECT_TRUE(map.in_segment(*map.find(points[0])));
  EXPECT_FALSE(map.in_segment(*map.find(points[2])));
  EXPECT_EQ(map.add_keyframe().segment, keyframes[0]->segment);

  map.join_segments(keyframes[2]->segment, keyframes[0]->segment);
  EXPECT_EQ(keyframes[0]->segment, keyframes[2]->segment);
  EXPECT_TRUE(map.in_segment(*map.find(points[0]))) << "the current one may be the one that is renamed";
  EXPECT_TRUE(map.in_segment(*map.find(points[2])));
  EXPECT_FALSE(map.in_segment(*map.find(points[1]))) << "of it, nothing more is known than before";
  const std::uint32_t joined = map.segment();
  map.begin_segment();
  EXPECT_GT(map.segment(), std::max(joined, keyframes[1]->segment)) << "a new one is new";
}

TEST(LocalMap, AnotherSegmentsKeyframeRepeatsNothing) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 6, 50);
  add_keyframe_at(map, 0);
  map.begin_segment();
  for (const double x : {0.0, 1.0, 1.4, 2.4, 3.4}) add_keyframe_at(map, x);
  add_keyframe_at(map, 4.4);
  EXPECT_NE(map.find_keyframe(1), nullptr) << "where it seems to lie says nothing";
  EXPECT_EQ(map.find_keyframe(3), nullptr) << "its neighbour is 40 cm off";
}

TEST(LocalMap, NewestKeyframeIsTheLastOneAdded) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 50);
  EXPECT_EQ(map.newest_keyframe(), nullptr);
  for (int i = 0; i < 20; ++i) {
    const Keyframe& added = add_keyframe_at(map, i);
    EXPECT_EQ(map.newest_keyframe(), &added);
    EXPECT_TRUE(added.features.empty());
  }
  const PoolUsage usage = map.keyframe_usage();
  EXPECT_EQ(usage.capacity, 8u);
  EXPECT_EQ(usage.high_water, 8u);
  EXPECT_EQ(usage.refused, 12u);
}

TEST(LocalMap, AFullRingGivesUpTheMostRepeatedView) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 50);
  std::vector<std::uint32_t> ids;
  // One metre apart, but for the third and fourth.
  for (const double x : {0.0, 1.0, 2.0, 2.1, 3.0, 4.0, 5.0, 6.0}) ids.push_back(add_keyframe_at(map, x).id);
  static_cast<void>(add_keyframe_at(map, 7));
  std::set<std::uint32_t> alive;
  for (const Keyframe& k : map.keyframes()) alive.insert(k.id);
  EXPECT_EQ(alive.size(), 8u);
  EXPECT_EQ(alive.count(ids[2]) + alive.count(ids[3]), 1u) << "one of the pair goes";
}

TEST(LocalMap, ATurnIsAnotherView) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 50);
  std::vector<std::uint32_t> ids;
  for (int i = 0; i < 8; ++i) ids.push_back(add_keyframe_at(map, i == 1 ? 0 : i, i == 1 ? 1.5 : 0).id);
  ids.push_back(add_keyframe_at(map, 9).id);
  std::set<std::uint32_t> alive;
  for (const Keyframe& k : map.keyframes()) alive.insert(k.id);
  EXPECT_TRUE(alive.contains(ids[1])) << "the same place, another direction";
}

TEST(LocalMap, TheNewestThreeStayHoweverAlike) {
  Arena arena(test::kArenaBytes);
  LocalMap map(arena, 8, 50);
  for (int i = 0; i < 5; ++i) static_cast<void>(add_keyframe_at(map, 10 * i));
  std::vector<std::uint32_t> newest;
  for (int i = 0; i < 3; ++i) newest.push_back(add_keyframe_at(map, 100).id);
  static_cast<void>(add_keyframe_at(map, 200));
  std::set<std::uint32_t> alive;
  for (const Keyframe& k : map.keyframes()) alive.insert(k.id);
  for (const std::uint32_t id : newest) EXPECT_TRUE(alive.contains(id));
}

TEST(LocalMap, CanBePlanned) {
  Arena plan;
  LocalMap map(plan, 64, 20000);
  EXPECT_GE(plan.bytes_planned(), 20000 * sizeof(MapPoint) + 64 * sizeof(Keyframe));
}

}  // namespace
}  // namespace stillmap
