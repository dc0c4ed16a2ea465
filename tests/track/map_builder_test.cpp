// SPDX-License-Identifier: Apache-2.0
#include "track/map_builder.h"

#include <gtest/gtest.h>

#include <cmath>

#include "posed_scene.h"

namespace stillmap {
namespace {

class MapBuilderTest : public testing::Test, protected test::PosedScene {
 protected:
  PosedFeatures posed(const Pose& T_odom_camera = {}, std::uint64_t sequence = 1) {
    return {frame, matches, T_odom_camera, sequence, 1000};
  }
  MapBuilder builder(DynamicRule rule = DynamicRule::Silhouette) {
    config.track.dynamic_rule = rule;
    return MapBuilder(config.track, camera);
  }
  std::size_t living() const {
    std::size_t n = 0;
    for (const MapPoint& p : map.points()) n += p.alive;
    return n;
  }
};

TEST_F(MapBuilderTest, ANewKeyframeMakesPointsOfWhatHasDepth) {
  const Pose T{exp_so3({0.1, 0.2, -0.1}), {1, 2, 3}};
  const Descriptor d = test::random_descriptor(random);
  see({0.4, -0.2, 2}, d, Label::Static, -1, 2);
  see({0.4, 0.3, 2}, d);
  frame.features[1].depth_m = 0;
  const Keyframe& k = builder().insert_keyframe(map, posed(T, 42), extractor);
  EXPECT_EQ(k.sequence, 42u);
  EXPECT_EQ(k.stamp_ns, 1000);
  EXPECT_EQ(k.features.size(), 2u);
  EXPECT_EQ(k.tracked_points, 1);
  EXPECT_EQ(living(), 1u);
  const MapPoint* point = map.find(k.features[0].point);
  ASSERT_NE(point, nullptr);
  EXPECT_EQ(matches[0].slot, k.features[0].point.slot) << "the frame's match is written back";
  EXPECT_EQ(matches[1].slot, -1);
  EXPECT_EQ(map.find(k.features[1].point), nullptr);
  const Vec3 truth = T * Vec3{0.4, -0.2, 2};
  EXPECT_LT(norm(point->p_odom - truth), 1e-6);
  EXPECT_NEAR(point->reference_distance_m, norm(Vec3{0.4, -0.2, 2}), 1e-6);
  EXPECT_LT(norm(point->p_odom + point->reference_distance_m * point->view_direction - T.t), 1e-6);
  EXPECT_EQ(point->reference_octave, 2);
  EXPECT_EQ(hamming(point->descriptor, d), 0);
  EXPECT_EQ(hamming(k.descriptors[0], d), 0);
  EXPECT_EQ(point->last_found_sequence, 42u);
  EXPECT_FALSE(point->suspect);
}

TEST_F(MapBuilderTest, WhatMayMoveEntersOnProbation) {
  for (const Label label : {Label::Static, Label::Dynamic, Label::SemiStatic, Label::Unknown}) {
    clear_frame();
    map.clear();
    see({0.1, 0.1, 2}, test::random_descriptor(random), label);
    const Keyframe& k = builder().insert_keyframe(map, posed(), extractor);
    const MapPoint* point = map.find(k.features[0].point);
    ASSERT_NE(point, nullptr);
    EXPECT_EQ(point->suspect, label != Label::Static);
  }
}

TEST_F(MapBuilderTest, PointsThatWereGivenUpComeBackFromTheirKeyframe) {
  const Pose T{exp_so3({0.1, 0.2, -0.1}), {1, 2, 3}};
  const Descriptor d = test::random_descriptor(random);
  see({0.4, -0.2, 2}, d, Label::Static, -1, 2);
  see({0.1, 0.1, 3}, test::random_descriptor(random));
  see({0.4, 0.3, 2}, d);
  frame.features[2].depth_m = 0;
  Keyframe& k = builder().insert_keyframe(map, posed(T, 42), extractor);
  const MapPoint before = *map.find(k.features[0].point);
  const PointRef stays = k.features[1].point;
  map.remove_point(static_cast<std::size_t>(k.features[0].point.slot));

  builder().revive_points(map, k, 77, extractor);
  EXPECT_EQ(living(), 2u) << "what has no depth has no place";
  EXPECT_EQ(k.features[1].point.id, stays.id) << "what is there stays as it is";
  const MapPoint* point = map.find(k.features[0].point);
  ASSERT_NE(point, nullptr);
  EXPECT_EQ(norm(point->p_odom - before.p_odom), 0);
  EXPECT_EQ(point->information, before.information);
  EXPECT_EQ(point->reference_octave, 2);
  EXPECT_EQ(hamming(point->descriptor, d), 0);
  EXPECT_EQ(point->made_ns, 1000);
  EXPECT_EQ(point->last_found_sequence, 77u) << "or it would be the first to go";
  EXPECT_TRUE(point->suspect) << "it has to prove that it stands still";
}

TEST_F(MapBuilderTest, WhatNeverEnteredTheMapDoesNotComeBack) {
  see({0.4, -0.2, 2}, test::random_descriptor(random), Label::Dynamic);
  Keyframe& k = builder(DynamicRule::Paper).insert_keyframe(map, posed(), extractor);
  builder(DynamicRule::Paper).revive_points(map, k, 77, extractor);
  EXPECT_EQ(living(), 0u);
}

TEST_F(MapBuilderTest, ThePaperLetsOnlyTheStaticIn) {
  for (const DynamicRule rule : {DynamicRule::Paper, DynamicRule::Off}) {
    clear_frame();
    map.clear();
    for (const Label label : {Label::Static, Label::Dynamic, Label::SemiStatic, Label::Unknown}) {
      see({0.1, 0.1, 2}, test::random_descriptor(random), label);
    }
    builder(rule).insert_keyframe(map, posed(), extractor);
    EXPECT_EQ(living(), 1u);
    EXPECT_GE(matches[0].slot, 0);
  }
}

TEST_F(MapBuilderTest, AKnownPointIsDescribedAnewAndNotDoubled) {
  const PointRef ref = add_point({0, 0, 2}, test::random_descriptor(random));
  const Descriptor newest = test::random_descriptor(random);
  see({0.5, 0, 1.5}, newest, Label::Static, ref.slot, 3);
  const Pose T{Mat3{}, {-0.5, 0, 0.5}};
  const Keyframe& k = builder().insert_keyframe(map, posed(T), extractor);
  EXPECT_EQ(living(), 1u);
  const MapPoint* point = map.find(ref);
  ASSERT_NE(point, nullptr);
  EXPECT_EQ(map.find(k.features[0].point), point);
  EXPECT_EQ(hamming(point->descriptor, newest), 0);
  EXPECT_EQ(point->reference_octave, 3);
  EXPECT_NEAR(point->reference_distance_m, std::hypot(0.5, 1.5), 1e-9);
  EXPECT_EQ(k.tracked_points, 1);
}

/// Culling before a keyframe may remove a point that this frame stands on, and its slot may be given away at
/// once.
TEST_F(MapBuilderTest, AMatchToARemovedPointIsNotAMatch) {
  const PointRef gone = add_point({0, 0, 2}, test::random_descriptor(random));
  map.remove_point(static_cast<std::size_t>(gone.slot));
  const Descriptor of_new = test::random_descriptor(random), of_stale = test::random_descriptor(random);
  see({0.5, 0, 2}, of_new);                            // takes the slot
  see({0, 0, 2}, of_stale, Label::Static, gone.slot);  // still thinks it stands on it
  const Keyframe& k = builder().insert_keyframe(map, posed(), extractor);
  const MapPoint* first = map.find(k.features[0].point);
  const MapPoint* second = map.find(k.features[1].point);
  ASSERT_NE(first, nullptr);
  EXPECT_EQ(hamming(first->descriptor, of_new), 0);
  EXPECT_NE(first, second);
  ASSERT_NE(second, nullptr) << "a static feature with depth and no point makes one";
  EXPECT_LT(norm(second->p_odom - Vec3{0, 0, 2}), 1e-6);
}

/// One look after another at different depths: the mean weighted by information, which along the ray of a
/// point straight ahead is scalar.
TEST_F(MapBuilderTest, RefiningIsTheInformationWeightedMean) {
  const double depths[] = {2.0, 2.06, 1.98, 2.02, 1.93};
  see({0, 0, depths[0]}, test::random_descriptor(random));
  builder().insert_keyframe(map, posed(), extractor);
  const auto slot = static_cast<std::size_t>(matches[0].slot);
  constexpr double kPoseSigma_m = 0.004;
  const auto information = [&](double z) {
    return 1 / (std::pow(camera.depth_sigma_m(z), 2) + kPoseSigma_m * kPoseSigma_m);
  };
  double weight = information(static_cast<float>(depths[0])), sum = weight * depths[0];
  for (std::size_t i = 1; i < std::size(depths); ++i) {
    frame.features[0].depth_m = static_cast<float>(depths[i]);
    builder().refine_points(map, posed({}, 10 + i), extractor);
    weight += information(depths[i]);
    sum += information(depths[i]) * depths[i];
  }
  const MapPoint& point = map.points()[slot];
  EXPECT_NEAR(point.p_odom.z, sum / weight, 1e-6);
  EXPECT_NEAR(point.p_odom.x, 0, 1e-9);
  EXPECT_NEAR(variance_along(point, {0, 0, 1}), 1 / weight, 1e-3 / weight);
  EXPECT_EQ(point.found, std::size(depths));
  EXPECT_EQ(point.last_found_sequence, 14u);
}

/// Two looks along different axes: each is sharp across its ray, so together they are sharp in every
/// direction.
TEST_F(MapBuilderTest, TwoViewsFuseAsTheirInformationMatrices) {
  const double sigma = std::hypot(camera.depth_sigma_m(2), 0.004), lateral = std::hypot(2 / camera.fx, 0.004);
  see({0, 0, 2}, test::random_descriptor(random));
  builder().insert_keyframe(map, posed(), extractor);
  // The second camera looks along -x at the same place from 2 m away; its depth is 3 cm too long.
  const Pose T_odom_second{exp_so3({0, -std::acos(0.0), 0}), {2, 0, 2}};
  ASSERT_LT(norm(T_odom_second * Vec3{0, 0, 2} - Vec3{0, 0, 2}), 1e-9);
  frame.features[0].depth_m = 2.03f;
  builder().refine_points(map, posed(T_odom_second), extractor);
  const MapPoint& point = map.points()[static_cast<std::size_t>(matches[0].slot)];
  const double z203 = std::hypot(camera.depth_sigma_m(2.03), 0.004);
  // Along x: the first is lateral at 0, the second axial at -0.03. Along z both say 2.
  const double wx1 = 1 / (lateral * lateral), wx2 = 1 / (z203 * z203);
  EXPECT_NEAR(point.p_odom.x, -0.03 * wx2 / (wx1 + wx2), 1e-5);
  EXPECT_NEAR(point.p_odom.z, 2, 1e-6);
  EXPECT_NEAR(variance_along(point, {1, 0, 0}), 1 / (wx1 + wx2), 0.01 / (wx1 + wx2));
  EXPECT_LT(variance_along(point, {0, 0, 1}), sigma * sigma);
}

TEST_F(MapBuilderTest, VarianceShrinksAndPlacesSettle) {
  see({0.3, 0.2, 2}, test::random_descriptor(random));
  builder().insert_keyframe(map, posed(), extractor);
  const MapPoint& point = map.points()[static_cast<std::size_t>(matches[0].slot)];
  double last = variance_along(point, {0, 0, 1});
  const double first = last;
  for (int look = 0; look < 39; ++look) {
    builder().refine_points(map, posed(), extractor);
    const double now = variance_along(point, {0, 0, 1});
    EXPECT_LT(now, last);
    last = now;
  }
  EXPECT_NEAR(last, first / 40, 0.02 * first);
  const Vec3 settled = point.p_odom;
  frame.features[0].depth_m = 2.2f;
  builder().refine_points(map, posed(), extractor);
  EXPECT_EQ(norm(point.p_odom - settled), 0);
  EXPECT_EQ(point.found, 41);
}

TEST_F(MapBuilderTest, ALookWithoutDepthCountsButDoesNotMove) {
  see({0.3, 0.2, 2}, test::random_descriptor(random));
  builder().insert_keyframe(map, posed(), extractor);
  frame.features[0].depth_m = 0;
  const MapPoint before = map.points()[static_cast<std::size_t>(matches[0].slot)];
  builder().refine_points(map, posed({}, 9), extractor);
  const MapPoint& after = map.points()[static_cast<std::size_t>(matches[0].slot)];
  EXPECT_EQ(norm(after.p_odom - before.p_odom), 0);
  EXPECT_EQ(after.information, before.information);
  EXPECT_EQ(after.found, 2);
  EXPECT_EQ(after.last_found_sequence, 9u);
}

TEST_F(MapBuilderTest, CullingTakesWhatIsRarelyFound) {
  const auto with = [&](std::uint16_t found, std::uint16_t visible) {
    const PointRef ref = add_point({0, 0, 2}, {});
    map.find(ref)->found = found;
    map.find(ref)->visible = visible;
    return ref;
  };
  const PointRef never = with(1, 5), young = with(1, 4), quarter = with(25, 100), rare = with(24, 100),
                 good = with(90, 100);
  builder().cull_points(map);
  EXPECT_EQ(map.find(never), nullptr);
  EXPECT_NE(map.find(young), nullptr);
  EXPECT_NE(map.find(quarter), nullptr);
  EXPECT_EQ(map.find(rare), nullptr);
  EXPECT_NE(map.find(good), nullptr);
  builder().cull_points(map);  // slots freed once
  EXPECT_EQ(living(), 3u);
}

/// A camera that stands still for an hour makes no keyframe, so nothing is culled, and every point is found
/// 108,000 times: more than its counters hold.
TEST_F(MapBuilderTest, CountersSurviveAnHourOfStandingStill) {
  constexpr int kFrames = 108'000;
  const PointRef ref = add_point({0, 0, 2}, test::random_descriptor(random));
  see({0, 0, 2}, map.find(ref)->descriptor, Label::Static, ref.slot);
  ProjectionMatcher matcher(arena, config.track, camera);
  const test::Image<std::uint16_t> depth(640, 480, 10000);
  matcher.project(map, {});
  for (int i = 0; i < kFrames; ++i) {
    // Found in nine frames of ten, as it is in life.
    if (i % 10 != 0) builder().refine_points(map, posed(), extractor);
    matcher.count_visible(map, depth.view());
    const MapPoint* point = map.find(ref);
    ASSERT_GE(point->found, i < 100 ? 1 : 40) << "after " << i << " frames";
    if (i < 10) continue;
    ASSERT_GT(point->found, 0.6 * point->visible) << "after " << i << " frames";
  }
  builder().cull_points(map);
  EXPECT_NE(map.find(ref), nullptr);
}

}  // namespace
}  // namespace stillmap
