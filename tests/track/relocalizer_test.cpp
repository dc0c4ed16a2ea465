// SPDX-License-Identifier: Apache-2.0
#include "track/relocalizer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <initializer_list>
#include <vector>

#include "posed_scene.h"
#include "track/depth_sampling.h"
#include "track/map_builder.h"

namespace stillmap {
namespace {

using test::angle_between;

class RelocalizerTest : public testing::Test, protected test::PosedScene {
 protected:
  /// A keyframe of `scene`, whose camera is odom's origin.
  const Keyframe& keyframe_of(const test::Scene& scene) {
    extract(scene);
    return builder.insert_keyframe(map, {frame, matches, {}, 0, 0}, extractor);
  }
  void extract(const test::Scene& scene) {
    extractor.extract(scene.grey.view(), frame);
    sample_depth(scene.depth(), camera, {}, frame.features);
    for (Feature& f : frame.features) f.label = Label::Static;
    matches.assign(frame.features.size(), {});
  }
  std::optional<FoundPose> relocalize(const Keyframe& k, std::uint64_t seed = 1) {
    relocalizer.take(frame);
    return relocalizer.find_by(k, Random(seed));
  }
  MapBuilder builder{config.track, camera};
  Relocalizer relocalizer{arena, config.track, camera};
  synthetic::SyntheticLog log{{.seed = 3, .people = 0}};
};

TEST_F(RelocalizerTest, FindsARenderedViewAgain) {
  const test::Scene start(log, 0);
  const Keyframe& k = keyframe_of(start);
  for (const int index : {0, 6, 12}) {
    const test::Scene later(log, index);
    extract(later);
    const auto T = relocalize(k);
    ASSERT_TRUE(T) << index;
    const Pose truth = inverse(later.truth.T_world_camera) * start.truth.T_world_camera;
    EXPECT_LT(norm(T->T_camera_odom.t - truth.t), 0.03) << index;
    EXPECT_LT(angle_between(T->T_camera_odom, truth), 0.015) << index;
    EXPECT_TRUE(T->sure) << index;
  }
}

TEST_F(RelocalizerTest, DoesNotFindAnotherRoom) {
  const Keyframe& k = keyframe_of(test::Scene(log, 0));
  synthetic::SyntheticLog elsewhere({.seed = 8, .people = 0});
  for (const int index : {0, 100, 200}) {
    extract(test::Scene(elsewhere, index));
    EXPECT_FALSE(relocalize(k)) << index;
  }
}

TEST_F(RelocalizerTest, NothingFromNothing) {
  const Keyframe& k = keyframe_of(test::Scene(log, 0));
  clear_frame();
  EXPECT_FALSE(relocalize(k)) << "no features";
  extract(test::Scene(log, 2));
  for (Feature& f : frame.features) f.depth_m = 0;
  EXPECT_FALSE(relocalize(k)) << "no depth";
  extract(test::Scene(log, 2));
  for (Feature& f : frame.features) f.label = Label::Dynamic;
  EXPECT_FALSE(relocalize(k)) << "only movers";
  extract(test::Scene(log, 2));
  EXPECT_TRUE(relocalize(k));
  for (std::size_t i = 0; i < map.points().size(); ++i) {
    if (map.points()[i].alive) map.remove_point(i);
  }
  EXPECT_TRUE(relocalize(k)) << "a keyframe remembers by itself, whatever has become of its points";
}

TEST_F(RelocalizerTest, TheSameRandomGivesTheSamePose) {
  const Keyframe& k = keyframe_of(test::Scene(log, 0));
  extract(test::Scene(log, 5));
  const auto a = relocalize(k, 4), b = relocalize(k, 4);
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->T_camera_odom.R.m, b->T_camera_odom.R.m);
  EXPECT_EQ(norm(a->T_camera_odom.t - b->T_camera_odom.t), 0);
}

TEST(PlacesToTry, TwoThatAreNoNeighbours) {
  std::vector<Keyframe> keyframes(6);
  for (std::uint32_t slot = 0; const std::uint32_t id : {7U, 20U, 19U, 18U, 17U, 3U})
    keyframes[slot++].id = id;
  const auto places = [&](std::initializer_list<std::size_t> slots) {
    std::vector<PlaceCandidate> candidates;
    for (const std::size_t slot : slots) candidates.push_back({.slot = slot});
    const PlacesToTry chosen = places_to_try(candidates, keyframes);
    return std::vector<std::size_t>(chosen.begin(), chosen.end());
  };
  using Slots = std::vector<std::size_t>;
  EXPECT_EQ(places({}), Slots{});
  EXPECT_EQ(places({3}), Slots{3});
  EXPECT_EQ(places({1, 2, 3, 0, 5}), (Slots{1, 0})) << "19 and 18 are beside 20";
  EXPECT_EQ(places({2, 1, 3, 4}), Slots{2}) << "on both sides";
  EXPECT_EQ(places({1, 4, 0}), (Slots{1, 4})) << "17 is three before 20";
}

}  // namespace
}  // namespace stillmap
