// SPDX-License-Identifier: Apache-2.0
#include "segment/main_depth.h"

#include <gtest/gtest.h>

#include "tests/segment/scene.h"

namespace stillmap {
namespace {

DepthRange main_depth_of(const test::Scene& scene, const Box& box) {
  DepthLayers grid(scene.camera);
  grid.read(scene.depth.view(), scene.camera, {0, 0, grid.columns(), grid.rows()});
  return main_depth(grid, grid.cells_of(box, 40));
}

bool holds(DepthRange r, int mm) {
  return mm >= r.near_mm && mm <= r.far_mm;
}

TEST(MainDepth, IsThePersonNotTheWall) {
  test::Scene scene;
  scene.wall(3000);
  scene.body(260, 100, 380, 400, 1800);
  const DepthRange main = main_depth_of(scene, {240, 90, 400, 410});
  EXPECT_TRUE(holds(main, 1850));
  EXPECT_FALSE(holds(main, 3000));
}

TEST(MainDepth, IsThePersonThoughTheWallFillsMoreOfTheBox) {
  test::Scene scene;
  scene.wall(3000);
  scene.body(280, 100, 360, 400, 1800);
  EXPECT_TRUE(holds(main_depth_of(scene, {210, 80, 430, 410}), 1850));
}

TEST(MainDepth, IsThePersonBehindADeskThatGoesOn) {
  test::Scene scene;
  scene.wall(4000);
  scene.body(260, 60, 380, 420, 2500);
  scene.paint(0, 300, 640, 480, [](int, int) { return 1300; });
  EXPECT_TRUE(holds(main_depth_of(scene, {250, 50, 390, 420}), 2550));
}

TEST(MainDepth, IsThePersonInADoorwayWithABiggerRoomBehind) {
  test::Scene scene;
  scene.wall(6000);
  scene.body(275, 80, 365, 400, 2800);
  scene.paint(0, 0, 200, 480, [](int, int) { return 3500; });
  scene.paint(440, 0, 640, 480, [](int, int) { return 3500; });
  EXPECT_TRUE(holds(main_depth_of(scene, {190, 10, 450, 470}), 2850));
}

TEST(MainDepth, IsTheBiggestHeapWhereNothingStandsOut) {
  test::Scene scene;
  scene.wall(2000);
  EXPECT_TRUE(holds(main_depth_of(scene, {200, 100, 400, 300}), 2000));
}

TEST(MainDepth, IsEmptyWithoutDepth) {
  EXPECT_TRUE(main_depth_of(test::Scene(), {200, 100, 400, 300}).empty());
  test::Scene outside;
  outside.wall(2000);
  outside.hole(200, 100, 400, 300);
  EXPECT_TRUE(main_depth_of(outside, {200, 104, 400, 296}).empty());
  EXPECT_TRUE(main_depth_of(outside, {700, 100, 900, 300}).empty())
      << "a box beside the picture has no depth";
}

}  // namespace
}  // namespace stillmap
