// SPDX-License-Identifier: Apache-2.0
#include "segment/depth_layers.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/segment/scene.h"

namespace stillmap {
namespace {

TEST(DepthLayers, GridsFitTheMaskAndCoverThePicture) {
  for (const auto& [w, h] :
       {std::pair(640, 480), std::pair(540, 360), std::pair(360, 540), std::pair(160, 120),
        std::pair(1280, 960), std::pair(1279, 481), std::pair(161, 960)}) {
    const test::Scene scene(w, h);
    const DepthLayers grid(scene.camera);
    EXPECT_LE(grid.columns(), DynamicMask::kMaxColumns);
    EXPECT_LE(grid.rows(), DynamicMask::kMaxRows);
    EXPECT_EQ(grid.columns(), (w - 1) / grid.cell_px() + 1);
    EXPECT_EQ(grid.rows(), (h - 1) / grid.cell_px() + 1);
  }
  EXPECT_EQ(DepthLayers(test::Scene().camera).cell_px(), 8);
}

DepthLayers read(const test::Scene& scene) {
  DepthLayers grid(scene.camera);
  grid.read(scene.depth.view(), scene.camera, {0, 0, grid.columns(), grid.rows()});
  return grid;
}

TEST(DepthLayers, AnEdgeCellKeepsBothSurfaces) {
  test::Scene scene;
  scene.wall(3000);
  scene.body(0, 0, 84, 480, 1500);
  const DepthLayers grid = read(scene);
  const DepthLayers::Cell& edge = grid.at(10, 30);  // pixels 80 to 87
  EXPECT_EQ(edge[0].samples, 8);
  EXPECT_NEAR(edge[0].middle_mm(), 1630, 25);
  EXPECT_EQ(edge[1].samples, 8);
  EXPECT_EQ(edge[1].near_mm, 3000);
  EXPECT_EQ(grid.at(20, 30)[0].samples, 16);
  EXPECT_EQ(grid.at(20, 30)[1].samples, 0);
}

TEST(DepthLayers, ASteepSurfaceIsOne) {
  test::Scene scene;
  scene.paint(0, 0, 640, 480, [](int x, int) { return 1000 + 4 * x; });
  const DepthLayers::Cell cell = read(scene).at(40, 30);
  EXPECT_EQ(cell[0].samples, 16);
  EXPECT_EQ(cell[1].samples, 0);
}

TEST(DepthLayers, IgnoresLonePixelsAndWhatTheCameraDoesNotTrust) {
  test::Scene scene;
  scene.wall(2000);
  scene.depth.view().at(3, 3) = 1000;
  EXPECT_EQ(read(scene).at(0, 0)[0].near_mm, 2000);
  test::Scene near_scene, far_scene, blind;
  near_scene.wall(299);
  far_scene.wall(8001);
  for (const test::Scene* s : {&near_scene, &far_scene, &blind}) EXPECT_EQ(read(*s).at(5, 5)[0].samples, 0);
}

TEST(DepthLayers, ReadsTheCellsOverThePicturesEdge) {
  test::Scene scene(547, 363);  // cells of 7 px: the last column and row have 1 and 6
  scene.wall(2000);
  const DepthLayers grid = read(scene);
  EXPECT_EQ(grid.columns(), 79);
  EXPECT_GT(grid.at(77, grid.rows() - 1)[0].samples, 8);
  EXPECT_GE(grid.at(78, 10)[0].samples, 4);
}

TEST(DepthLayers, SurfaceGapGrowsWithTheNoise) {
  const DepthLayers grid(test::Scene().camera);
  EXPECT_NEAR(grid.surface_gap_mm(1000), 47, 2);
  EXPECT_NEAR(grid.surface_gap_mm(4000), 190, 8);
  EXPECT_GT(grid.surface_gap_mm(65535), grid.surface_gap_mm(8000));
}

TEST(DepthLayers, ClipsBoxesWhereverTheyLie) {
  const DepthLayers grid(test::Scene().camera);
  const BoxCells inside = grid.cells_of({80, 81, 160, 159}, 20);
  EXPECT_EQ(inside.box.x0, 10);
  EXPECT_EQ(inside.box.y0, 10);
  EXPECT_EQ(inside.box.x1, 20);
  EXPECT_EQ(inside.box.y1, 20);
  EXPECT_EQ(inside.around.x0, 7);
  EXPECT_EQ(inside.around.x1, 23);
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(),
                  kInf = std::numeric_limits<float>::infinity();
  for (const Box& b : {Box{-1e9f, -1e9f, 1e9f, 1e9f}, Box{kNan, kNan, kNan, kNan},
                       Box{-kInf, -kInf, kInf, kInf}, Box{700, 500, 900, 600}, Box{-90, -90, -50, -50}}) {
    for (const CellRect& r : {grid.cells_of(b, 20).box, grid.cells_of(b, 20).around}) {
      EXPECT_TRUE(0 <= r.x0 && r.x0 <= 80 && 0 <= r.x1 && r.x1 <= 80) << b.x0;
      EXPECT_TRUE(0 <= r.y0 && r.y0 <= 60 && 0 <= r.y1 && r.y1 <= 60) << b.x0;
    }
  }
}

}  // namespace
}  // namespace stillmap
