// SPDX-License-Identifier: Apache-2.0
#include "map/mover_sightings.h"

#include <gtest/gtest.h>

#include <vector>

namespace stillmap {
namespace {

constexpr Nanoseconds kTenth_ns = 100'000'000;

/// A camera that looks along z, and boxes 40 px wide at 2 m, where a metre is 250 px.
class MoverSightingsTest : public testing::Test {
 protected:
  static CameraModel camera() {
    CameraModel c;
    c.width = 640;
    c.height = 480;
    c.fx = c.fy = 500;
    c.cx = 319.5;
    c.cy = 239.5;
    return c;
  }
  static Detection box(float x, float score, float depth_m = 2, ClassKind kind = ClassKind::Dynamic) {
    return {.box = {x - 20, 200, x + 20, 300}, .kind = kind, .score = score, .depth_m = depth_m};
  }
  /// What is left of the boxes at `tenths` of a second.
  std::vector<float> left_of(int tenths, const std::vector<Detection>& found, const Pose& T_map_camera = {}) {
    Detections boxes;
    boxes.stamp_ns = tenths * kTenth_ns;
    for (const Detection& d : found) EXPECT_TRUE(boxes.items.try_push_back(d));
    const bool removed = sightings.filter(boxes, T_map_camera);
    EXPECT_EQ(removed, boxes.items.size() < found.size());
    std::vector<float> scores;
    for (const Detection& d : boxes.items) scores.push_back(d.score);
    return scores;
  }
  using Scores = std::vector<float>;
  Arena arena{1 << 18};
  MoverSightings sightings{arena, camera(), 0.4};
};

TEST_F(MoverSightingsTest, AWeakBoxByItselfDoesNotCountAndOthersDo) {
  EXPECT_EQ(left_of(0, {box(100, 0.49f), box(500, 0.5f)}), Scores{0.5f});
  EXPECT_EQ(left_of(1, {box(100, 0.4f, 0), box(100, 0.41f, 2, ClassKind::SemiStatic), box(100, 0.42f)}),
            (Scores{0.4f, 0.41f}))
      << "without depth it has no place, and only what moves is asked";
}

TEST_F(MoverSightingsTest, WhatIsSureGoesByTheNetworksScores) {
  sightings = MoverSightings(arena, camera(), 0.24);
  EXPECT_EQ(left_of(0, {box(100, 0.29f), box(500, 0.31f)}), Scores{0.31f});
}

TEST_F(MoverSightingsTest, AWeakBoxCountsForASecondWhereAMoverWasSurelyFound) {
  left_of(0, {box(320, 0.6f)});
  EXPECT_EQ(left_of(10, {box(320, 0.4f)}).size(), 1u);
  sightings = MoverSightings(arena, camera(), 0.4);
  left_of(0, {box(320, 0.6f)});
  EXPECT_TRUE(left_of(11, {box(320, 0.4f)}).empty());
}

TEST_F(MoverSightingsTest, NearIsMeasuredInSpace) {
  left_of(0, {box(100, 0.6f)});
  EXPECT_EQ(left_of(1, {box(292, 0.4f)}).size(), 1u) << "0.77 m";
  EXPECT_TRUE(left_of(1, {box(308, 0.4f)}).empty()) << "0.83 m";
  EXPECT_TRUE(left_of(1, {box(100, 0.4f, 3.2f)}).empty()) << "behind it";
  const Pose turned{exp_so3({0, 0.5, 0}), {}};
  EXPECT_EQ(left_of(2, {box(100 - 273, 0.4f)}, turned).size(), 1u) << "the same place from elsewhere";
}

TEST_F(MoverSightingsTest, WhatIsFoundForAWhileCounts) {
  for (int tenths = 0; tenths < 4; ++tenths) EXPECT_TRUE(left_of(tenths, {box(320, 0.36f)}).empty());
  EXPECT_EQ(left_of(4, {box(320, 0.36f)}).size(), 1u);
  EXPECT_TRUE(left_of(20, {box(320, 0.36f)}).empty()) << "found again after a pause, it is new";
}

TEST_F(MoverSightingsTest, TheNewestAreKept) {
  for (int i = 0; i < 40; ++i) left_of(0, std::vector<Detection>(64, box(100, 0.6f)));
  left_of(1, {box(600, 0.6f)});
  EXPECT_EQ(left_of(2, {box(600, 0.4f)}).size(), 1u);
}

}  // namespace
}  // namespace stillmap
