// SPDX-License-Identifier: Apache-2.0
#include "segment/object_growth.h"

#include <gtest/gtest.h>

#include "tests/segment/scene.h"

namespace stillmap {
namespace {

/// The share of an area's pixels whose depth is the object's.
double share_taken(const test::Scene& scene, const Box& box, DepthRange main, CellRect pixels) {
  DepthLayers grid(scene.camera);
  grid.read(scene.depth.view(), scene.camera, {0, 0, grid.columns(), grid.rows()});
  const ObjectGrowth growth(grid, grid.cells_of(box, 40), main);
  int taken = 0;
  for (int y = pixels.y0; y < pixels.y1; ++y) {
    for (int x = pixels.x0; x < pixels.x1; ++x) {
      const DepthRange range = growth.depths_at(x / grid.cell_px(), y / grid.cell_px());
      const int mm = scene.depth.view().at(x, y);
      taken += mm >= range.near_mm && mm <= range.far_mm;
    }
  }
  return static_cast<double>(taken) / pixels.area();
}

TEST(ObjectGrowth, ReachesAnOutstretchedArm) {
  test::Scene scene;
  scene.wall(3500);
  scene.body(260, 100, 380, 400, 1800);
  scene.paint(370, 180, 470, 210,
              [](int x, int) { return 1940 - 4 * (x - 370); });  // towards the camera, to 1.54 m
  const Box box{250, 90, 475, 410};
  EXPECT_GT(share_taken(scene, box, {1750, 1950}, {380, 180, 470, 210}), 0.95);
  EXPECT_LT(share_taken(scene, box, {1750, 1950}, {384, 230, 470, 400}), 0.02);
}

TEST(ObjectGrowth, LeavesTheDeskThatThePersonTouches) {
  // A desk that rises away from the camera and runs into the person at the person's own depth.
  test::Scene scene;
  scene.wall(3500);
  scene.body(240, 60, 400, 330, 1500);
  scene.paint(0, 330, 640, 480, [](int, int y) { return 1500 - 4 * (y - 330); });
  const Box box{230, 50, 410, 380};
  EXPECT_GT(share_taken(scene, box, {1450, 1650}, {250, 60, 390, 330}), 0.97);
  EXPECT_LT(share_taken(scene, box, {1450, 1650}, {230, 346, 410, 380}), 0.3);
  EXPECT_LT(share_taken(scene, box, {1450, 1650}, {0, 346, 190, 420}), 0.01);
}

TEST(ObjectGrowth, FollowsAHeadOutOfTheBoxButNoWall) {
  test::Scene scene;
  scene.wall(3000);
  scene.body(260, 100, 380, 400, 1800);
  const Box cut{250, 130, 390, 410};
  EXPECT_GT(share_taken(scene, cut, {1750, 1950}, {270, 104, 370, 130}), 0.95);
  test::Scene poster;
  poster.wall(2000);
  EXPECT_GT(share_taken(poster, cut, {1900, 2100}, {256, 136, 384, 400}), 0.99);
  EXPECT_EQ(share_taken(poster, cut, {1900, 2100}, {200, 80, 240, 450}), 0);
}

TEST(ObjectGrowth, TakesPartsCutOffByWhatStandsBefore) {
  test::Scene scene;
  scene.wall(3500);
  scene.body(260, 60, 380, 440, 2200);
  scene.paint(0, 350, 640, 390, [](int, int) { return 1200; });  // a table's edge, below the core
  const Box box{250, 50, 390, 450};
  EXPECT_GT(share_taken(scene, box, {2100, 2350}, {270, 394, 370, 440}), 0.95);
  EXPECT_LT(share_taken(scene, box, {2100, 2350}, {250, 354, 390, 386}), 0.02);
}

TEST(ObjectGrowth, TakesTheHolesThatTouchIt) {
  test::Scene scene;
  scene.wall(3000);
  scene.body(260, 100, 380, 400, 1800);
  scene.hole(280, 100, 360, 180);
  scene.hole(264, 420, 376, 436);  // a hole of the wall's, below
  DepthLayers grid(scene.camera);
  grid.read(scene.depth.view(), scene.camera, {0, 0, grid.columns(), grid.rows()});
  const ObjectGrowth growth(grid, grid.cells_of({250, 90, 390, 450}, 40), {1750, 1950});
  EXPECT_EQ(growth.depths_at(40, 16).near_mm, 0);
  EXPECT_EQ(growth.depths_at(40, 16).far_mm, 65535);
  EXPECT_TRUE(growth.depths_at(40, 53).empty());
}

}  // namespace
}  // namespace stillmap
