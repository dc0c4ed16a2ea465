// SPDX-License-Identifier: Apache-2.0
#include "track/localizer.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "posed_scene.h"

namespace stillmap {
namespace {

using test::angle_between;

/// Points that a camera at `truth` sees, where they are.
class LocalizerTest : public testing::Test, protected test::PosedScene {
 protected:
  void see_points(int count) { see_points_moved(count, truth); }
  /// That have moved since the map saw them, as if the camera were at `elsewhere`.
  void see_points_moved(int count, const Pose& elsewhere) {
    for (int i = 0; i < count; ++i) {
      const Vec3 p = anywhere_in_view();
      const Descriptor d = test::random_descriptor(random);
      add_point(elsewhere * p, d, truth.t);
      see(p, d);
    }
    grid.build(frame);
  }
  /// What is seen.
  void keep_as_keyframe() {
    Keyframe& keyframe = map.add_keyframe();
    keyframe.T_odom_camera = truth;
    for (const Feature& f : frame.features)
      static_cast<void>(keyframe.features.try_push_back({f.ray_x, f.ray_y, f.depth_m, f.octave, {}}));
    std::ranges::copy(frame.descriptors, keyframe.descriptors.begin());
  }
  void begin(const std::optional<PosePrior>& prior = {}, bool movers_known = true) {
    localizer.begin(1, 33'000'000, prior, movers_known);
  }
  bool found_truth() {
    return norm(localizer.T_odom_camera().t - truth.t) < 1e-3 &&
           angle_between(localizer.T_odom_camera(), truth) < 1e-3;
  }
  /// `truth`, turned about the camera's own vertical axis.
  Pose turned_by(double rad) const { return truth * Pose{exp_so3({0, rad, 0}), {}}; }

  Pose truth{exp_so3({0.1, 0.4, 0}), {1, 0.2, -0.3}};
  FeatureGrid grid{arena, kMaxFeatures, camera};
  Localizer localizer{arena, config, map, frame, grid, extractor};
};

TEST_F(LocalizerTest, FollowsAGuessAndRefinesIt) {
  see_points(300);
  begin();
  ASSERT_TRUE(localizer.follow({turned_by(0.02), {}, false, 300}));
  ASSERT_TRUE(localizer.refine());
  EXPECT_TRUE(found_truth());
  EXPECT_EQ(localizer.estimate().inliers, 300);
  EXPECT_EQ(localizer.matched(), 300);
  for (const FeatureMatch& m : localizer.matches()) EXPECT_GE(m.slot, 0);
}

TEST_F(LocalizerTest, ThePictureAsAWholeHelpsWhereThePredictionIsWrong) {
  see_points(300);
  begin();
  ASSERT_TRUE(localizer.follow({turned_by(0.3), turned_by(0.01), false, 300}));
  EXPECT_TRUE(found_truth());
  begin();
  EXPECT_FALSE(localizer.follow({turned_by(0.3), {}, false, 300})) << "160 px off, and nothing else to go by";
}

TEST_F(LocalizerTest, AfterALongStepTheNewestKeyframeAsAWholeHelps) {
  see_points(150);
  keep_as_keyframe();
  begin();
  ASSERT_TRUE(localizer.follow({turned_by(0.3), {}, true, 300}));
  EXPECT_TRUE(found_truth());
  begin();
  EXPECT_FALSE(localizer.follow({turned_by(0.3), {}, false, 300})) << "comparing takes as long as a frame";
}

TEST_F(LocalizerTest, LooksNoFurtherThanTwoGuessesThatLeadToOnePlace) {
  see_points(40);
  keep_as_keyframe();
  begin();
  ASSERT_TRUE(localizer.follow({turned_by(0.02), turned_by(0.01), true, 300}));
  EXPECT_TRUE(found_truth());
  EXPECT_EQ(localizer.searches(), 2);
  begin();
  ASSERT_TRUE(localizer.follow({turned_by(0.02), turned_by(0.3), true, 300}));
  EXPECT_TRUE(found_truth());
  EXPECT_EQ(localizer.searches(), 3) << "the other guess leads nowhere: the newest keyframe is asked";
}

TEST_F(LocalizerTest, KeepsTheBestOfItsSearches) {
  see_points(40);
  begin();
  ASSERT_TRUE(localizer.follow({turned_by(0.01), turned_by(0.3), false, 300}));
  EXPECT_EQ(localizer.searches(), 2) << "one around a guess that leads nowhere was the last";
  EXPECT_TRUE(found_truth());
  EXPECT_EQ(localizer.estimate().inliers, 40);
  EXPECT_EQ(localizer.matched(), 40);
  for (const FeatureMatch& m : localizer.matches()) EXPECT_GE(m.slot, 0);
  ASSERT_TRUE(localizer.refine()) << "the points in view are those of the best";
  EXPECT_EQ(localizer.estimate().inliers, 40);
}

TEST_F(LocalizerTest, ALaterSearchThatFindsFewerIsNotTheBest) {
  see_points_moved(25, turned_by(0.3));
  see_points(40);
  begin();
  ASSERT_TRUE(localizer.around(turned_by(0.3))) << "those that moved agree with one another";
  ASSERT_TRUE(localizer.follow({turned_by(0.01), turned_by(0.3), false, 300}));
  EXPECT_TRUE(found_truth());
  EXPECT_EQ(localizer.estimate().inliers, 40);
}

TEST_F(LocalizerTest, FewFeaturesCorrectThePriorInsteadOfReplacingIt) {
  const int few = config.track.min_inliers / 2 + 2;
  see_points(few);
  begin();
  EXPECT_FALSE(localizer.follow({turned_by(0.005), {}, false, 300})) << "too few by themselves";
  begin(PosePrior{inverse(turned_by(0.005)), 0.01, 0.01});
  ASSERT_TRUE(localizer.follow({turned_by(0.005), {}, false, 300}));
  EXPECT_EQ(localizer.estimate().inliers, few);
  EXPECT_LT(angle_between(localizer.T_odom_camera(), truth), 0.001);
}

TEST_F(LocalizerTest, FindsTheStillPointsAmongMoreThatMovedWhereMoversAreKnown) {
  // Those that agree with the guess are many enough to hold the descent, but the still ones are the most.
  see_points_moved(60, turned_by(0.02));
  see_points_moved(40, turned_by(0.04));
  see_points(90);
  begin();
  ASSERT_TRUE(localizer.around(turned_by(0.02)));
  ASSERT_TRUE(localizer.refine());
  EXPECT_TRUE(found_truth());
  EXPECT_EQ(localizer.estimate().inliers, 90);
  begin({}, false);
  localizer.around(turned_by(0.02));
  EXPECT_FALSE(found_truth()) << "without a network, the most may be people";
}

TEST_F(LocalizerTest, OutliersAreNoMatches) {
  see_points(200);
  const Vec3 p = anywhere_in_view();
  const Descriptor d = test::random_descriptor(random);
  add_point(truth * Vec3{p.x + 0.02, p.y, p.z}, d, truth.t);  // has moved since
  see(p, d);
  grid.build(frame);
  begin();
  ASSERT_TRUE(localizer.follow({truth, {}, false, 200}));
  EXPECT_EQ(localizer.matched(), 201);
  EXPECT_EQ(localizer.estimate().inliers, 200);
  EXPECT_EQ(localizer.matches().back().slot, -1);
}

}  // namespace
}  // namespace stillmap
