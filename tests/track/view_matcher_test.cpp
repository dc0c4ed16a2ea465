// SPDX-License-Identifier: Apache-2.0
#include "track/view_matcher.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "keyframe_scene.h"
#include "track/depth_sampling.h"
#include "track/feature_extractor.h"
#include "track/loop_closer.h"

namespace stillmap {
namespace {

using test::angle_between;
using test::corners_before;
using test::SceneCorner;

const Pose kThere{exp_so3({0.05, 0.2, -0.1}), {0.4, -0.1, 0.2}};

class ViewMatcherTest : public testing::Test {
 protected:
  std::optional<ViewMatch> match(std::uint64_t seed = 1) { return matcher.match(*a, *b, Random(seed)); }
  bool convincing() {
    const auto m = match();
    return m && m->is_convincing();
  }
  /// Both keyframes see the same corners, b from the world's origin and a from kThere.
  void see_the_same(const std::vector<SceneCorner>& corners) {
    test::see(config.camera, {}, corners, *b);
    test::see(config.camera, kThere, corners, *a);
  }
  Config config = test::synthetic_config();
  Arena arena{test::kArenaBytes};
  ViewMatcher matcher{arena, config.track, config.camera};
  std::unique_ptr<Keyframe> a = std::make_unique<Keyframe>(), b = std::make_unique<Keyframe>();
  Random random{7};
};

TEST_F(ViewMatcherTest, FindsTheMotionAndCountsWhatSpeaksForIt) {
  see_the_same(corners_before({}, 400, random));
  const auto m = match();
  ASSERT_TRUE(m);
  EXPECT_LT(norm(m->T_a_b.t - inverse(kThere).t), 1e-4);
  EXPECT_LT(angle_between(m->T_a_b, inverse(kThere)), 1e-4);
  const auto seen = static_cast<int>(a->features.size());
  EXPECT_GT(seen, 200);
  EXPECT_GE(m->pairs, seen - 5) << "all of a's are also b's";
  EXPECT_GE(m->agreeing_pairs, seen - 5);
  EXPECT_EQ(m->inliers, seen);
  EXPECT_EQ(m->in_view, seen);
  EXPECT_EQ(m->agreeing_depths, m->depths);
  EXPECT_GT(m->spread, 0.1);
  EXPECT_TRUE(m->is_convincing());
}

/// The information is of the left perturbation: what moves the pose by one sigma costs one.
TEST_F(ViewMatcherTest, InformationAllowsForWhatTheSolverCannotKnow) {
  see_the_same(corners_before({}, 400, random));
  const auto m = match();
  ASSERT_TRUE(m);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_LT(m->information[7 * i], i < 3 ? 1.05e4 : 4.5e3) << "never surer than 0.01 rad and 15 mm";
    EXPECT_GT(m->information[7 * i], 1e3);
  }
  EXPECT_NEAR(m->information[1], m->information[6], 1e-6) << "symmetric";
}

TEST_F(ViewMatcherTest, WrongPairsAreSortedOut) {
  auto corners = corners_before({}, 300, random);
  test::see(config.camera, {}, corners, *b);
  for (std::size_t i = 0; i < corners.size(); i += 3) {
    corners[i].descriptor =
        corners[(i + 30) % corners.size()].descriptor;  // two thirds lead astray or nowhere
    corners[(i + 1) % corners.size()].p_world = corners_before(kThere, 1, random)[0].p_world;
  }
  test::see(config.camera, kThere, corners, *a);
  const auto m = match();
  ASSERT_TRUE(m);
  EXPECT_LT(norm(m->T_a_b.t - inverse(kThere).t), 0.01);
  EXPECT_LT(angle_between(m->T_a_b, inverse(kThere)), 0.005);
}

TEST_F(ViewMatcherTest, AnotherPlaceIsNoMatch) {
  test::see(config.camera, {}, corners_before({}, 400, random), *b);
  test::see(config.camera, {}, corners_before({}, 400, random), *a);
  EXPECT_FALSE(convincing());
}

/// Wallpaper: the same marks at equal distances, so that any of a thousand shifts fits as well.
TEST_F(ViewMatcherTest, RepeatedTextureIsNoMatch) {
  const Descriptor mark = test::random_descriptor(random), other_mark = test::random_descriptor(random);
  std::vector<SceneCorner> wall;
  for (int x = -15; x <= 15; ++x) {
    for (int y = -12; y <= 12; ++y)
      wall.push_back({{0.1 * x, 0.1 * y, 2}, (x + y) % 2 == 0 ? mark : other_mark});
  }
  see_the_same(wall);
  for (Keyframe* keyframe : {a.get(), b.get()}) {
    for (std::size_t i = 0; i < keyframe->features.size(); ++i) {
      for (int flips = 0; flips < 12; ++flips)
        keyframe->descriptors[i].bits[random.below(4)] ^= std::uint64_t{1} << random.below(64);
    }
  }
  EXPECT_FALSE(convincing());
}

/// The same poster hangs in two rooms: its corners fit perfectly, and nothing around them does.
TEST_F(ViewMatcherTest, AThingThatIsInTwoPlacesIsNoMatch) {
  std::vector<SceneCorner> poster;
  for (int i = 0; i < 120; ++i)
    poster.push_back({{0.5 * random.uniform(), 0.4 * random.uniform(), 2}, test::random_descriptor(random)});
  for (Keyframe* keyframe : {a.get(), b.get()}) {
    auto room = corners_before({}, 300, random);
    room.insert(room.end(), poster.begin(), poster.end());
    test::see(config.camera, {}, room, *keyframe);
  }
  const auto m = match();
  ASSERT_TRUE(m) << "the poster alone does fit";
  EXPECT_GE(m->inliers, 100);
  EXPECT_FALSE(m->is_convincing());
}

TEST_F(ViewMatcherTest, AFewCornersInOneSpotAreNoMatch) {
  auto corners = corners_before({}, 30, random);
  for (int i = 0; i < 100; ++i)
    corners.push_back(
        {{0.3 + 0.1 * random.uniform(), 0.1 * random.uniform(), 2.5}, test::random_descriptor(random)});
  see_the_same(corners);
  for (std::size_t i = 0; i < a->features.size(); ++i) {
    if (i < 25) a->descriptors[i] = test::random_descriptor(random);
  }
  EXPECT_FALSE(convincing());
}

TEST_F(ViewMatcherTest, NothingFromNothing) {
  EXPECT_FALSE(match()) << "no features";
  see_the_same(corners_before({}, 200, random));
  for (KeyframeFeature& f : a->features) f.depth_m = 0;
  EXPECT_FALSE(match()) << "no depth";
  see_the_same(corners_before({}, 5, random));
  EXPECT_FALSE(match()) << "too few";
  const auto one = corners_before({}, 1, random);
  see_the_same(std::vector<SceneCorner>(200, one[0]));
  EXPECT_FALSE(match()) << "all in one place";
}

TEST_F(ViewMatcherTest, TheSameRandomGivesTheSameMatch) {
  see_the_same(corners_before({}, 200, random));
  const auto one = match(4), two = match(4);
  ASSERT_TRUE(one && two);
  EXPECT_EQ(one->T_a_b.R.m, two->T_a_b.R.m);
  EXPECT_EQ(one->information, two->information);
}

TEST_F(ViewMatcherTest, RenderedViewsMatchAndOtherRoomsDoNot) {
  FeatureExtractor extractor(arena, config.track, config.camera);
  FrameFeatures frame(arena, kMaxFeatures);
  synthetic::SyntheticLog room({.seed = 3, .people = 0}), other_room({.seed = 8, .people = 0});
  const auto look = [&](synthetic::SyntheticLog& log, int index, Keyframe& out) {
    const test::Scene scene(log, index);
    extractor.extract(scene.grey.view(), frame);
    sample_depth(scene.depth(), config.camera, {}, frame.features);
    out.features.clear();
    for (std::size_t i = 0; i < frame.features.size(); ++i) {
      const Feature& f = frame.features[i];
      out.descriptors[i] = frame.descriptors[i];
      ASSERT_TRUE(out.features.try_push_back({f.ray_x, f.ray_y, f.depth_m, f.octave, {}}));
    }
    out.T_odom_camera = scene.truth.T_world_camera;
  };
  look(room, 0, *b);
  look(room, 14, *a);
  const auto m = match();
  ASSERT_TRUE(m);
  EXPECT_TRUE(m->is_convincing());
  const Pose truth = inverse(a->T_odom_camera) * b->T_odom_camera;
  EXPECT_LT(norm(m->T_a_b.t - truth.t), 0.02);
  EXPECT_LT(angle_between(m->T_a_b, truth), 0.01);
  look(other_room, 0, *a);
  EXPECT_FALSE(convincing()) << "the same furniture shop";
}

}  // namespace
}  // namespace stillmap
