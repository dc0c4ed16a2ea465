// SPDX-License-Identifier: Apache-2.0
#include "runtime/scene.h"

#include <gtest/gtest.h>

#include <vector>

namespace stillmap {
namespace {

TEST(Scene, ObjectsHaveTheDepthOfTheirCellsAndTheVelocityOfTheMap) {
  DynamicMask mask;
  mask.rule = DynamicRule::Silhouette;
  mask.columns = 80;
  mask.rows = 60;
  const Detection walker{.box = {10, 20, 110, 220},
                         .class_id = 3,
                         .kind = ClassKind::Dynamic,
                         .score = 0.7F,
                         .depth_m = 9,
                         .object = 5,
                         .age_ns = 77,
                         .velocity_m_s = {1, 0, 0}};
  const Detection table{.box = {}, .kind = ClassKind::Static},
      chair{.box = {}, .kind = ClassKind::SemiStatic, .depth_m = 3};
  for (const Detection& d : {walker, table, chair}) ASSERT_TRUE(mask.boxes.items.try_push_back(d));
  mask.cells[100] = {2000, 2400, Label::Dynamic, 0};
  mask.cells[101] = {1000, 1400, Label::Dynamic, 0};
  mask.cells[102] = {0, 65535, Label::Dynamic, 0};  // a hole: it says nothing of depth
  TrackingResult result;
  result.sequence = 8;
  result.stamp_ns = 9;
  result.state = TrackState::Tracking;
  result.T_map_odom.R = rotation_from({.w = std::sqrt(0.5), .z = std::sqrt(0.5)});
  const std::vector<Feature> features{{.x = 4.6F, .y = 7.4F, .label = Label::Dynamic}};
  StreamScene scene;
  make_scene(result, mask, features, scene);
  EXPECT_EQ(scene.sequence, 8U);
  EXPECT_EQ(scene.stamp_ns, 9);
  EXPECT_TRUE(scene.has_pose);
  ASSERT_EQ(scene.objects.size(), 2U);
  const StreamObject& object = scene.objects[0];
  EXPECT_EQ(object.id, 5U);
  EXPECT_EQ(object.class_id, 3U);
  EXPECT_EQ(object.age_ns, 77);
  EXPECT_NEAR(object.near_m, 1.5, 1e-5);
  EXPECT_NEAR(object.far_m, 1.9, 1e-5);
  EXPECT_NEAR(object.velocity_m_s.y, 1, 1e-9) << "x of odom is y of map";
  EXPECT_NEAR(scene.objects[1].near_m, 3, 1e-5) << "no cell: the detection's own depth";
  EXPECT_GT(scene.objects[1].far_m, 3);
  ASSERT_EQ(scene.features.size(), 1U);
  EXPECT_EQ(scene.features[0].x, 5);
  EXPECT_EQ(scene.features[0].y, 7);
  EXPECT_EQ(scene.features[0].label, Label::Dynamic);
}

}  // namespace
}  // namespace stillmap
