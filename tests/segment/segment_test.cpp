// SPDX-License-Identifier: Apache-2.0
#include "segment/segment.h"

#include <gtest/gtest.h>

#include <initializer_list>
#include <limits>
#include <memory>

#include "tests/segment/scene.h"

namespace stillmap {
namespace {

using test::box_of;

std::unique_ptr<DynamicMask> mask_of(const test::Scene& scene, std::initializer_list<Detection> boxes,
                                     DynamicRule rule = DynamicRule::Silhouette) {
  Detections detections;
  detections.sequence = 7;
  for (const Detection& d : boxes) EXPECT_TRUE(detections.items.try_push_back(d));
  auto mask = std::make_unique<DynamicMask>();
  segment(detections, scene.depth.view(), scene.camera, rule, *mask);
  return mask;
}

/// The share of the pixels of an area that are labelled so.
double share(const DynamicMask& mask, const test::Scene& scene, Label label, int x0, int y0, int x1, int y1) {
  int found = 0;
  for (int y = y0; y < y1; ++y) {
    for (int x = x0; x < x1; ++x) found += label_at(mask, x, y, scene.depth_m(x, y)) == label;
  }
  return static_cast<double>(found) / ((x1 - x0) * (y1 - y0));
}

test::Scene person_before_wall() {
  test::Scene scene;
  scene.wall(3000);
  scene.body(260, 100, 380, 400, 1800);
  return scene;
}

TEST(Segment, OffIsEmpty) {
  const auto mask = mask_of(person_before_wall(), {box_of(250, 90, 390, 410)}, DynamicRule::Off);
  EXPECT_TRUE(mask->boxes.items.empty());
  EXPECT_EQ(mask->boxes.sequence, 7u);
  for (const DynamicMask::Cell& cell : mask->cells) EXPECT_EQ(cell.label, Label::Static);
}

TEST(Segment, PaperIsTheBoxesAlone) {
  const test::Scene scene = person_before_wall();
  const auto mask = mask_of(scene, {box_of(250, 90, 390, 410), box_of(300, 200, 330, 230, ClassKind::Static)},
                            DynamicRule::Paper);
  EXPECT_EQ(label_at(*mask, 252, 92, 3.0), Label::Dynamic);
  EXPECT_EQ(label_at(*mask, 310, 210, 1.8), Label::Static);
  for (const DynamicMask::Cell& cell : mask->cells) EXPECT_EQ(cell.label, Label::Static);
}

TEST(Segment, SplitsAPersonFromTheWall) {
  const test::Scene scene = person_before_wall();
  const auto mask = mask_of(scene, {box_of(240, 90, 400, 410)});
  EXPECT_EQ(share(*mask, scene, Label::Dynamic, 260, 100, 380, 400), 1);
  EXPECT_EQ(share(*mask, scene, Label::Static, 240, 90, 260, 410), 1);
  EXPECT_EQ(share(*mask, scene, Label::Static, 0, 0, 240, 480), 1);
  EXPECT_EQ(label_at(*mask, 245, 200, 3.0), Label::Static);
  EXPECT_EQ(label_at(*mask, 300, 200, 1.8), Label::Dynamic);
}

TEST(Segment, AMaskIsMadeAnewEachTime) {
  const test::Scene scene = person_before_wall();
  auto mask = mask_of(scene, {box_of(240, 90, 400, 410)});
  segment({}, scene.depth.view(), scene.camera, DynamicRule::Silhouette, *mask);
  EXPECT_EQ(share(*mask, scene, Label::Static, 0, 0, 640, 480), 1);
  EXPECT_TRUE(mask->boxes.items.empty());
}

TEST(Segment, HolesOfAPersonAreUnknownNeverStatic) {
  test::Scene scene = person_before_wall();
  scene.hole(280, 100, 360, 160);
  scene.hole(300, 250, 330, 280);
  const auto mask = mask_of(scene, {box_of(240, 90, 400, 410)});
  EXPECT_EQ(share(*mask, scene, Label::Unknown, 280, 104, 360, 160), 1);
  EXPECT_EQ(share(*mask, scene, Label::Unknown, 300, 250, 330, 280), 1);
  EXPECT_EQ(label_at(*mask, 320, 130, 2.7), Label::Dynamic) << "a stray reading within a hole";
}

TEST(Segment, TheRoomSeenBetweenLegsAndArmsStays) {
  test::Scene scene;
  scene.wall(3000);
  scene.body(260, 80, 380, 260, 1800);
  scene.body(260, 260, 300, 420, 1850);
  scene.body(340, 260, 380, 420, 1850);
  const auto mask = mask_of(scene, {box_of(255, 75, 385, 425)});
  EXPECT_EQ(share(*mask, scene, Label::Dynamic, 260, 260, 300, 420), 1);
  EXPECT_EQ(share(*mask, scene, Label::Static, 301, 265, 339, 420), 1);
}

TEST(Segment, TwoPeopleOneBehindTheOther) {
  test::Scene scene;
  scene.wall(4000);
  scene.body(200, 60, 340, 420, 2600);
  scene.body(290, 40, 430, 460, 1500);
  const auto mask = mask_of(scene, {box_of(195, 55, 345, 425), box_of(285, 35, 435, 465)});
  EXPECT_GT(share(*mask, scene, Label::Dynamic, 200, 60, 290, 420), 0.99);
  EXPECT_GT(share(*mask, scene, Label::Dynamic, 290, 40, 430, 460), 0.99);
  EXPECT_EQ(share(*mask, scene, Label::Static, 345, 30, 430, 40), 1);
  EXPECT_EQ(share(*mask, scene, Label::Static, 205, 428, 280, 470), 1);
  EXPECT_EQ(mask->cell_at(250, 200).object, 0);
  EXPECT_EQ(mask->cell_at(400, 200).object, 1);
  EXPECT_EQ(mask->cell_at(290, 200).object, 1) << "the nearer of two in one cell";
  EXPECT_EQ(mask_of(scene, {box_of(285, 35, 435, 465), box_of(195, 55, 345, 425)})->cell_at(290, 200).object,
            0);
}

TEST(Segment, CatchesTheHeadThatTheBoxCutOff) {
  const test::Scene scene = person_before_wall();
  const auto mask = mask_of(scene, {box_of(250, 130, 390, 410)});
  EXPECT_EQ(share(*mask, scene, Label::Dynamic, 270, 102, 370, 130), 1);
}

TEST(Segment, APersonBeforeAScreenIsAPerson) {
  test::Scene scene;
  scene.wall(3000);
  scene.paint(150, 120, 500, 330, [](int, int) { return 2500; });
  scene.body(260, 100, 380, 400, 1800);
  const auto mask =
      mask_of(scene, {box_of(150, 120, 500, 330, ClassKind::Static), box_of(250, 90, 390, 410)});
  EXPECT_EQ(share(*mask, scene, Label::Dynamic, 260, 100, 380, 400), 1);
  EXPECT_EQ(share(*mask, scene, Label::Static, 150, 120, 258, 330), 1);
}

TEST(Segment, WhereNothingStandsOutTheBoxIsTheObjectAndNoMore) {
  test::Scene scene;
  scene.wall(2000);
  const auto mask = mask_of(scene, {box_of(200, 160, 320, 280)});
  EXPECT_EQ(share(*mask, scene, Label::Dynamic, 200, 160, 320, 280), 1);
  EXPECT_EQ(share(*mask, scene, Label::Static, 0, 0, 190, 480), 1);
  EXPECT_EQ(share(*mask, scene, Label::Static, 330, 0, 640, 480), 1);
}

TEST(Segment, ABoxWithoutDepthIsTheObject) {
  test::Scene scene;
  scene.wall(2000);
  scene.hole(200, 160, 320, 280);
  const auto mask = mask_of(scene, {box_of(200, 160, 320, 280)});
  EXPECT_EQ(share(*mask, scene, Label::Unknown, 200, 160, 320, 280), 1);
  EXPECT_EQ(label_at(*mask, 250, 200, 5), Label::Dynamic);
  EXPECT_EQ(share(*mask, scene, Label::Static, 0, 0, 200, 480), 1);
}

TEST(Segment, StandsOnTheFloor) {
  test::Scene scene;
  scene.wall(5000);
  scene.floor(1200);
  scene.body(280, 130, 360, 430, 3200);
  const auto mask = mask_of(scene, {box_of(272, 122, 368, 440)});
  EXPECT_GT(share(*mask, scene, Label::Dynamic, 280, 130, 360, 430), 0.99);
  EXPECT_LT(share(*mask, scene, Label::Dynamic, 200, 440, 440, 480), 0.1) << "the floor before the feet";
  EXPECT_EQ(share(*mask, scene, Label::Dynamic, 0, 400, 230, 480), 0)
      << "the floor beside, beyond the margin";
}

TEST(Segment, BoxesMayReachOverThePicture) {
  test::Scene scene;
  scene.wall(3000);
  scene.body(-60, 100, 80, 520, 1500);
  const auto mask = mask_of(scene, {box_of(-80, 90, 90, 530)});
  EXPECT_GT(share(*mask, scene, Label::Dynamic, 0, 100, 80, 480), 0.99);
  EXPECT_EQ(share(*mask, scene, Label::Static, 100, 0, 640, 480), 1);
}

TEST(Segment, SurvivesEveryBox) {
  const test::Scene scene = person_before_wall();
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kHuge = std::numeric_limits<float>::max();
  for (const Detection& d :
       {box_of(900, 900, 950, 950), box_of(-50, -50, -10, -10), box_of(300, 200, 300, 200),
        box_of(400, 300, 200, 100), box_of(kNan, kNan, kNan, kNan), box_of(-kHuge, -kHuge, kHuge, kHuge),
        box_of(639, 479, 640, 480), box_of(0, 0, 640, 480)}) {
    const auto mask = mask_of(scene, {d});
    EXPECT_EQ(share(*mask, scene, Label::SemiStatic, 0, 0, 640, 480), 0);
  }
  Detections full;
  while (full.items.try_push_back(box_of(240, 90, 400, 410))) {
  }
  DynamicMask mask;
  segment(full, scene.depth.view(), scene.camera, DynamicRule::Silhouette, mask);
  EXPECT_EQ(label_at(mask, 320, 250, 1.8), Label::Dynamic);
}

TEST(Segment, ChairsAreSemiStaticAndPeopleOnThemDynamic) {
  test::Scene scene;
  scene.wall(4000);
  scene.body(200, 250, 440, 450, 2050);
  scene.body(260, 100, 380, 400, 1900);
  const Detection chair = box_of(195, 245, 445, 455, ClassKind::SemiStatic),
                  person = box_of(255, 95, 385, 405);
  for (const auto& mask : {mask_of(scene, {chair, person}), mask_of(scene, {person, chair})}) {
    EXPECT_GT(share(*mask, scene, Label::Dynamic, 264, 100, 376, 400), 0.97);
    EXPECT_GT(share(*mask, scene, Label::SemiStatic, 200, 260, 240, 440), 0.95);
  }
  EXPECT_EQ(share(*mask_of(scene, {box_of(195, 90, 445, 455, ClassKind::Ignored)}), scene, Label::Static, 0,
                  0, 640, 480),
            1);
}

TEST(Segment, WorksAtEveryPictureSize) {
  for (const auto& [w, h] :
       {std::pair(160, 120), std::pair(540, 360), std::pair(1280, 960), std::pair(641, 479)}) {
    test::Scene scene(w, h);
    scene.wall(3000);
    scene.body(w * 2 / 5, h / 4, w * 3 / 5, h * 3 / 4, 1800);
    const auto mask = mask_of(scene, {box_of(static_cast<float>(w) * 0.38f, static_cast<float>(h) * 0.22f,
                                             static_cast<float>(w) * 0.62f, static_cast<float>(h) * 0.77f)});
    EXPECT_GT(share(*mask, scene, Label::Dynamic, w * 2 / 5, h / 4, w * 3 / 5, h * 3 / 4), 0.98) << w;
    EXPECT_EQ(share(*mask, scene, Label::Static, w * 2 / 3, 0, w, h), 1) << w;
  }
}

}  // namespace
}  // namespace stillmap
