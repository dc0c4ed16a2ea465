// SPDX-License-Identifier: Apache-2.0
#include "track/semi_static_check.h"

#include <gtest/gtest.h>

#include <cmath>

#include "posed_scene.h"

namespace stillmap {
namespace {

/// A still world and a chair, seen before and after the camera moved. The chair may move on its own.
class SemiStaticCheckTest : public testing::Test, protected test::PosedScene {
 protected:
  struct World {
    std::size_t still = 150, chair = 30;
    Vec3 chair_moved{};  ///< between the frames
    Pose T_previous_current{exp_so3({0.005, -0.01, 0.004}), {0.05, 0.01, 0.01}};
    double noise_px = 0.3;
    bool flat = false;  ///< the still world is one wall
    double chair_depth_m = 2;
  };

  /// Runs the check over both frames; the chair's features come last.
  void run(const World& world, std::uint64_t seed = 5) {
    still_ = world.still;
    Random draw(seed);
    std::vector<Vec3> points;
    std::vector<Descriptor> descriptors;
    for (std::size_t i = 0; i < world.still; ++i) {
      const double z = world.flat ? 3 : 1.2 + 3 * draw.uniform();
      points.push_back({(draw.uniform() - 0.5) * z, (draw.uniform() - 0.5) * 0.8 * z, z});
      descriptors.push_back(test::random_descriptor(draw));
    }
    for (std::size_t i = 0; i < world.chair; ++i) {
      points.push_back(
          {0.4 * draw.uniform(), 0.4 * draw.uniform(), world.chair_depth_m + 0.3 * draw.uniform()});
      descriptors.push_back(test::random_descriptor(draw));
    }
    const auto view = [&](const Pose& T_camera_previous, Vec3 chair_moved) {
      clear_frame();
      for (std::size_t i = 0; i < points.size(); ++i) {
        const bool chair = i >= world.still;
        const Vec3 p = T_camera_previous * (chair ? points[i] + chair_moved : points[i]);
        see(p, descriptors[i], chair ? Label::SemiStatic : Label::Static,
            chair ? -1 : static_cast<std::int32_t>(i));
        Feature& f = frame.features[i];
        f.ray_x += static_cast<float>(world.noise_px * test::gaussian(draw) / camera.fx);
        f.ray_y += static_cast<float>(world.noise_px * test::gaussian(draw) / camera.fy);
      }
    };
    view({}, {});
    check.remember(frame, matches);
    view(inverse(world.T_previous_current), world.chair_moved);
    check.relabel(frame, matches, world.T_previous_current, Random(seed));
  }
  std::size_t chair_features(Label label) const {
    std::size_t n = 0;
    for (std::size_t i = still_; i < frame.features.size(); ++i) n += frame.features[i].label == label;
    return n;
  }
  std::size_t still_features(Label label) const {
    std::size_t n = 0;
    for (std::size_t i = 0; i < still_; ++i) n += frame.features[i].label == label;
    return n;
  }
  std::size_t still_ = 0;
  SemiStaticCheck check{arena, config.track, camera, kMaxFeatures};
};

TEST_F(SemiStaticCheckTest, AStandingChairIsStatic) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    run({}, seed);
    EXPECT_GE(chair_features(Label::Static), 26u) << seed;
    EXPECT_EQ(still_features(Label::Static), 150u);
  }
}

TEST_F(SemiStaticCheckTest, AMovingChairIsDynamic) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    run({.chair_moved = {0, 0.04, 0}}, seed);  // 10 px across the camera's motion
    EXPECT_GE(chair_features(Label::Dynamic), 28u) << seed;
    EXPECT_EQ(still_features(Label::Static), 150u) << "only semi-static features are judged";
  }
}

TEST_F(SemiStaticCheckTest, APureTurnSaysNothing) {
  run({.chair_moved = {0, 0.04, 0}, .T_previous_current = {exp_so3({0.01, -0.03, 0.01}), {}}});
  EXPECT_EQ(chair_features(Label::SemiStatic), 30u);
  run({.T_previous_current = {}});
  EXPECT_EQ(chair_features(Label::SemiStatic), 30u);
}

TEST_F(SemiStaticCheckTest, TooFewStillPointsSayNothing) {
  run({.still = 10});
  EXPECT_EQ(chair_features(Label::SemiStatic), 30u);
}

/// Points of one wall fit many fundamental matrices: one picked from them would judge the chair before the
/// wall by chance.
TEST_F(SemiStaticCheckTest, AStandingChairBeforeAWallIsNotCalledDynamic) {
  std::size_t wrong = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    run({.flat = true, .chair_depth_m = 1.2}, seed);
    wrong += chair_features(Label::Dynamic);
  }
  EXPECT_LE(wrong, 20u * 30u / 20u);
}

TEST_F(SemiStaticCheckTest, TheFirstFrameSaysNothing) {
  see({0, 0, 2}, test::random_descriptor(random), Label::SemiStatic);
  check.relabel(frame, matches, {}, Random(1));
  EXPECT_EQ(frame.features[0].label, Label::SemiStatic);
}

TEST_F(SemiStaticCheckTest, AFeatureWithoutCounterpartStaysAsItIs) {
  run({});
  const std::size_t judged = chair_features(Label::Static);
  ASSERT_GT(judged, 20u);
  // A new frame whose chair looks like nothing before.
  check.remember(frame, matches);
  for (std::size_t i = 150; i < 180; ++i) {
    frame.features[i].label = Label::SemiStatic;
    frame.descriptors[i] = test::random_descriptor(random);
  }
  for (std::size_t i = 0; i < 150; ++i) frame.features[i].ray_x += 0.01f;
  check.relabel(frame, matches, {Mat3{}, {0.02, 0, 0}}, Random(1));
  EXPECT_EQ(chair_features(Label::SemiStatic), 30u);
}

TEST_F(SemiStaticCheckTest, SlotsOfAnOlderFrameAreForgotten) {
  run({});
  clear_frame();
  check.remember(frame, matches);  // an empty frame, as behind a covered lens
  run({.chair_moved = {0, 0.04, 0}});
  EXPECT_GE(chair_features(Label::Dynamic), 28u);
}

}  // namespace
}  // namespace stillmap
