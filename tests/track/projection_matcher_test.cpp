// SPDX-License-Identifier: Apache-2.0
#include "track/projection_matcher.h"

#include <gtest/gtest.h>

#include <cmath>

#include "posed_scene.h"

namespace stillmap {
namespace {

/// `d` with `count` bits flipped.
Descriptor flipped(Descriptor d, int count, int from = 0) {
  for (int i = from; i < from + count; ++i)
    d.bits[static_cast<std::size_t>(i / 64)] ^= std::uint64_t{1} << (i % 64);
  return d;
}

class ProjectionMatcherTest : public testing::Test, protected test::PosedScene {
 protected:
  int match(const Pose& T_camera_odom = {}, const SearchWindow& window = {}) {
    matcher.project(map, T_camera_odom);
    grid.build(frame);
    out.assign(frame.features.size(), {7, 7});
    return matcher.match(map, frame, grid, window, extractor, out);
  }
  ProjectionMatcher matcher{arena, config.track, camera};
  FeatureGrid grid{arena, kMaxFeatures, camera};
  std::vector<FeatureMatch> out;
  Descriptor some = test::random_descriptor(random);
};

TEST_F(ProjectionMatcherTest, FindsEveryPointOfAMovedCamera) {
  const Pose T_camera_odom{exp_so3({0.05, -0.1, 0.2}), {0.1, 0.05, -0.2}};
  std::vector<PointRef> refs;
  for (int i = 0; i < 300; ++i) {
    const Vec3 p = anywhere_in_view();
    const Descriptor d = test::random_descriptor(random);
    refs.push_back(add_point(inverse(T_camera_odom) * p, d));
    see(p, flipped(d, 20));
  }
  EXPECT_EQ(match(T_camera_odom), 300);
  for (std::size_t i = 0; i < 300; ++i) {
    EXPECT_EQ(out[i].slot, refs[i].slot);
    EXPECT_EQ(out[i].distance, 20);
  }
}

TEST_F(ProjectionMatcherTest, ReprojectingFindsWhatABetterPoseShows) {
  const Pose rough, better{exp_so3({0, 0.03, 0}), {0.02, 0, 0}};  // 16 px apart
  for (int i = 0; i < 200; ++i) {
    const Vec3 p = anywhere_in_view();
    const Descriptor d = test::random_descriptor(random);
    add_point(inverse(better) * p, d);
    see(p, d);
  }
  EXPECT_LT(match(rough), 100);
  matcher.reproject(map, better);
  EXPECT_EQ(matcher.match(map, frame, grid, {}, extractor, out), 200);
  matcher.reproject(map, {exp_so3({0, M_PI, 0}), {}});
  EXPECT_EQ(matcher.match(map, frame, grid, {}, extractor, out), 0) << "all is behind the camera now";
}

TEST_F(ProjectionMatcherTest, TheWindowLimitsPlaceDepthAndDescriptor) {
  add_point({0, 0, 2}, some);
  const auto matches_at = [&](Vec3 p, const Descriptor& d, SearchWindow window) {
    clear_frame();
    see(p, d);
    return match({}, window);
  };
  const auto px = [&](double pixels, double z = 2) { return Vec3{pixels / camera.fx * z, 0, z}; };
  EXPECT_EQ(matches_at(px(7.9), some, {.radius_px = 8}), 1);
  EXPECT_EQ(matches_at(px(8.1), some, {.radius_px = 8}), 0);
  EXPECT_EQ(out[0].slot, -1) << "earlier contents are overwritten";
  EXPECT_EQ(matches_at(px(0, 2.19), some, {.depth_share = 0.1}), 1);
  EXPECT_EQ(matches_at(px(0, 2.21), some, {.depth_share = 0.1}), 0);
  EXPECT_EQ(matches_at(px(0, 1.79), some, {.depth_share = 0.1}), 0);
  EXPECT_EQ(matches_at(px(0), flipped(some, 64), {.max_distance = 64}), 1);
  EXPECT_EQ(matches_at(px(0), flipped(some, 65), {.max_distance = 64}), 0);
  clear_frame();
  see(px(0, 3), some);
  frame.features[0].depth_m = 0;
  EXPECT_EQ(match(), 1) << "without a reading, depth says nothing";
}

TEST_F(ProjectionMatcherTest, OnlyUsableLabelsUnlessAsked) {
  add_point({0, 0, 2}, some);
  for (const auto& [label, expected] :
       {std::pair{Label::Static, 1}, {Label::SemiStatic, 1}, {Label::Dynamic, 0}, {Label::Unknown, 0}}) {
    clear_frame();
    see({0, 0, 2}, some, label);
    EXPECT_EQ(match(), expected);
    EXPECT_EQ(match({}, {.any_label = true}), 1);
  }
}

TEST_F(ProjectionMatcherTest, OctavesFollowTheDistance) {
  add_point({0, 0, 2}, some, {}, 3);
  const auto matches_on = [&](int octave, double z) {
    clear_frame();
    see({0, 0, z}, some, Label::Static, -1, octave);
    return match({Mat3{}, {0, 0, z - 2}});
  };
  for (const int octave : {2, 3, 4}) EXPECT_EQ(matches_on(octave, 2), 1);
  EXPECT_EQ(matches_on(1, 2), 0);
  EXPECT_EQ(matches_on(5, 2), 0);
  // From farther it looks smaller, which is a finer octave: two levels at 1.44 times the distance.
  EXPECT_EQ(matches_on(1, 2 * 1.44), 1);
  EXPECT_EQ(matches_on(3, 2 * 1.44), 0);
  EXPECT_EQ(matches_on(5, 2 / 1.44), 1);
  EXPECT_EQ(matches_on(3, 2 / 1.44), 0);
}

TEST_F(ProjectionMatcherTest, AnAmbiguousMatchIsNoMatch) {
  add_point({0, 0, 2}, some);
  for (const bool better_first : {true, false}) {
    clear_frame();
    see({0.002, 0, 2}, flipped(some, better_first ? 30 : 33));
    see({0, 0.002, 2}, flipped(some, better_first ? 33 : 30));
    EXPECT_EQ(match(), 0) << better_first;
    clear_frame();
    see({0.002, 0, 2}, flipped(some, better_first ? 20 : 33));
    see({0, 0.002, 2}, flipped(some, better_first ? 33 : 20));
    EXPECT_EQ(match(), 1) << better_first;
    EXPECT_GE(out[better_first ? 0 : 1].slot, 0);
  }
}

/// The verdict must not hang on the order in which the grid hands out the two candidates, whose second one
/// lies just beyond the limit.
TEST_F(ProjectionMatcherTest, ARivalBeyondTheLimitIsARivalInEitherOrder) {
  add_point({0, 0, 2}, some);
  for (const bool better_first : {true, false}) {
    clear_frame();
    see({0.001, 0, 2}, flipped(some, better_first ? 63 : 66));
    see({0.001, 0, 2}, flipped(some, better_first ? 66 : 63));
    EXPECT_EQ(match({}, {.max_distance = 64}), 0) << better_first;
  }
}

TEST_F(ProjectionMatcherTest, ARivalOnAnotherOctaveIsTheSameCorner) {
  add_point({0, 0, 2}, some, {}, 2);
  see({0.002, 0, 2}, flipped(some, 30), Label::Static, -1, 2);
  see({0, 0.002, 2}, flipped(some, 33), Label::Static, -1, 3);
  EXPECT_EQ(match(), 1);
}

TEST_F(ProjectionMatcherTest, AFeatureTakesTheNearestPoint) {
  add_point({0.003, 0, 2}, flipped(some, 25));
  const PointRef nearest = add_point({0, 0, 2}, flipped(some, 5));
  add_point({0, 0.003, 2}, flipped(some, 15));
  see({0, 0, 2}, some);
  EXPECT_EQ(match(), 1) << "one feature, one match";
  EXPECT_EQ(out[0].slot, nearest.slot);
  EXPECT_EQ(out[0].distance, 5);
}

TEST_F(ProjectionMatcherTest, LeavesOutWhatCannotBeSeen) {
  add_point({0, 0, -2}, some);              // behind
  add_point({0, 0, 0.05}, some);            // too near
  add_point({3, 0, 2}, some);               // beyond the picture
  add_point({0, 0, 2}, some, {0, 0, 4});    // described from the other side
  add_point({0, 0, 2}, some, {0, 0, -30});  // so far away then that it would be on no octave now
  const PointRef dead = add_point({0, 0, 2}, some);
  map.remove_point(static_cast<std::size_t>(dead.slot));
  see({0, 0, 2}, some);
  EXPECT_EQ(match(), 0);
}

TEST_F(ProjectionMatcherTest, NoFeaturesNoMatches) {
  add_point({0, 0, 2}, some);
  EXPECT_EQ(match(), 0);
}

TEST_F(ProjectionMatcherTest, CountsWhatShouldHaveBeenSeen) {
  const PointRef open = add_point({0, 0, 2}, some), hidden = add_point({0.5, 0, 2}, some),
                 outside = add_point({1.25, 0, 2}, some), nearer = add_point({-0.5, 0, 1.5}, some),
                 hole = add_point({0, 0.5, 2}, some);
  test::Image<std::uint16_t> depth(640, 480, 10000);  // 2 m
  const auto put = [&](Vec3 p, std::uint16_t raw) {
    const Vec2 pixel = camera.project(p);
    depth.view().at(static_cast<int>(std::lround(pixel.x)), static_cast<int>(std::lround(pixel.y))) = raw;
  };
  put({0.5, 0, 2}, 6000);
  put({0, 0.5, 2}, 0);
  matcher.project(map, {});
  matcher.count_visible(map, depth.view());
  EXPECT_EQ(map.find(open)->visible, 2);
  EXPECT_EQ(map.find(hidden)->visible, 1) << "something stands before it";
  EXPECT_EQ(map.find(outside)->visible, 1) << "within the margin, but no pixel shows it";
  EXPECT_EQ(map.find(nearer)->visible, 2) << "the wall is seen through where it should be: it is gone";
  EXPECT_EQ(map.find(hole)->visible, 2);
}

}  // namespace
}  // namespace stillmap
