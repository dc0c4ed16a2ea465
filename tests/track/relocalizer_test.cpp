// SPDX-License-Identifier: Apache-2.0
#include "track/relocalizer.h"

#include <gtest/gtest.h>

#include <cmath>

#include "posed_scene.h"
#include "track/depth_sampling.h"
#include "track/map_builder.h"

namespace stillmap {
namespace {

using test::angle_between;

const Pose kMotion{exp_so3({0.7, -1.2, 2.0}), {0.4, -3, 1.5}};

std::vector<Vec3> moved(const std::vector<Vec3>& from) {
  std::vector<Vec3> to;
  for (const Vec3& p : from) to.push_back(kMotion * p);
  return to;
}

TEST(AbsoluteOrientation, ThreePointsAreEnoughAndExact) {
  const std::vector<Vec3> from{{0, 0, 1}, {1, 0, 2}, {0.3, 0.8, 1.5}};
  const auto T = absolute_orientation(from, moved(from));
  ASSERT_TRUE(T);
  EXPECT_LT(norm(T->t - kMotion.t), 1e-9);
  EXPECT_LT(angle_between(*T, kMotion), 1e-8);
}

TEST(AbsoluteOrientation, HalfATurnIsExactToo) {
  for (const Vec3 turn :
       {Vec3{3.14159265358979, 0, 0}, {0, 3.14159265358979, 0}, {0, 0, 3.14159265358979}, {0, 0, 0}}) {
    const Pose T_truth{exp_so3(turn), {1, 2, 3}};
    std::vector<Vec3> from{{0, 0, 1}, {1, 0, 2}, {0.3, 0.8, 1.5}, {-1, 0.2, 0.4}}, to;
    for (const Vec3& p : from) to.push_back(T_truth * p);
    const auto T = absolute_orientation(from, to);
    ASSERT_TRUE(T);
    for (std::size_t i = 0; i < from.size(); ++i) EXPECT_LT(norm(*T * from[i] - to[i]), 1e-8);
  }
}

TEST(AbsoluteOrientation, ManyNoisyPointsAverage) {
  Random random(3);
  std::vector<Vec3> from(500), to;
  for (Vec3& p : from) p = test::gaussian_vec(random, 1);
  for (const Vec3& p : moved(from)) to.push_back(p + test::gaussian_vec(random, 0.05));
  const auto T = absolute_orientation(from, to);
  ASSERT_TRUE(T);
  EXPECT_LT(norm(T->t - kMotion.t), 4 * 0.05 / std::sqrt(500.0) * 2);
  EXPECT_LT(angle_between(*T, kMotion), 0.01);
}

/// A mirror image has no rotation that fits; the answer must be a rotation all the same.
TEST(AbsoluteOrientation, NeverAMirror) {
  const std::vector<Vec3> from{{0, 0, 1}, {1, 0, 2}, {0.3, 0.8, 1.5}, {-1, 0.2, 0.4}};
  std::vector<Vec3> to;
  for (const Vec3& p : from) to.push_back({-p.x, p.y, p.z});
  const auto T = absolute_orientation(from, to);
  if (!T) return;
  const Mat3& R = T->R;
  const double det =
      dot(cross({R(0, 0), R(1, 0), R(2, 0)}, {R(0, 1), R(1, 1), R(2, 1)}), {R(0, 2), R(1, 2), R(2, 2)});
  EXPECT_NEAR(det, 1, 1e-9);
}

TEST(AbsoluteOrientation, UndecidedGivesNothing) {
  const std::vector<Vec3> two{{0, 0, 1}, {1, 0, 2}}, same(5, Vec3{1, 2, 3});
  std::vector<Vec3> line;
  for (int i = 0; i < 6; ++i) line.push_back({0.3 * i, 1 - 0.2 * i, 2 + 0.1 * i});
  EXPECT_FALSE(absolute_orientation({}, {}));
  EXPECT_FALSE(absolute_orientation(two, moved(two)));
  EXPECT_FALSE(absolute_orientation(same, moved(same)));
  EXPECT_FALSE(absolute_orientation(line, moved(line)));
  EXPECT_FALSE(absolute_orientation(line, moved(two))) << "not as many";
}

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
  std::optional<Pose> relocalize(const Keyframe& k, std::uint64_t seed = 1) {
    return relocalizer.relocalize(map, k, frame, extractor, Random(seed));
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
    EXPECT_LT(norm(T->t - truth.t), 0.03) << index;
    EXPECT_LT(angle_between(*T, truth), 0.015) << index;
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
  EXPECT_FALSE(relocalize(k)) << "a keyframe whose points are gone";
}

TEST_F(RelocalizerTest, TheSameRandomGivesTheSamePose) {
  const Keyframe& k = keyframe_of(test::Scene(log, 0));
  extract(test::Scene(log, 5));
  const auto a = relocalize(k, 4), b = relocalize(k, 4);
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->R.m, b->R.m);
  EXPECT_EQ(norm(a->t - b->t), 0);
}

/// A share of the descriptors lead to the wrong place: sampling sorts them out.
TEST_F(RelocalizerTest, SurvivesWrongPairs) {
  Keyframe& k = map.add_keyframe();
  const Pose truth{exp_so3({0.1, 0.4, -0.2}), {0.5, 0, 0.2}};
  for (int i = 0; i < 100; ++i) {
    const Vec3 p = anywhere_in_view();
    const Descriptor d = test::random_descriptor(random);
    k.descriptors[k.features.size()] = d;
    ASSERT_TRUE(k.features.try_push_back({0, 0, 1, 0, add_point(inverse(truth) * p, d)}));
    see(i < 60 ? p : anywhere_in_view(), d);
  }
  const auto T = relocalize(k);
  ASSERT_TRUE(T);
  EXPECT_LT(norm(T->t - truth.t), 1e-3);
  EXPECT_LT(angle_between(*T, truth), 1e-3);
}

}  // namespace
}  // namespace stillmap
