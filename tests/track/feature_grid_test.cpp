// SPDX-License-Identifier: Apache-2.0
#include "track/feature_grid.h"

#include <gtest/gtest.h>

#include <set>

#include "scene.h"

namespace stillmap {
namespace {

const CameraModel kCamera = synthetic::SyntheticLog::camera();

std::vector<Feature> scattered(std::size_t count, double spread) {
  Random random(9);
  std::vector<Feature> features(count);
  for (Feature& f : features) {
    // With spread > 1 some lie outside the picture, as undistorting does.
    f.ray_x = static_cast<float>((random.uniform() - 0.5) * spread * kCamera.width / kCamera.fx);
    f.ray_y = static_cast<float>((random.uniform() - 0.5) * spread * kCamera.height / kCamera.fy);
  }
  return features;
}

TEST(FeatureGrid, FindsExactlyWhatBruteForceFinds) {
  const std::vector<Feature> features = scattered(1200, 1.3);
  Arena arena(test::kArenaBytes);
  FeatureGrid grid(arena, features.size(), kCamera);
  grid.build(features);
  Random random(3);
  for (int trial = 0; trial < 500; ++trial) {
    const double u = random.uniform() * 900 - 130, v = random.uniform() * 700 - 110,
                 radius = random.uniform() * 80;
    std::multiset<std::size_t> found, expected;
    grid.for_each_near(u, v, radius, [&](std::size_t i) { found.insert(i); });
    for (std::size_t i = 0; i < features.size(); ++i) {
      const double du = grid.u_of(features[i]) - u, dv = grid.v_of(features[i]) - v;
      if (du * du + dv * dv <= radius * radius) expected.insert(i);
    }
    ASSERT_EQ(found, expected) << u << ", " << v << " radius " << radius;
  }
}

TEST(FeatureGrid, FeaturesBeyondThePictureAreFound) {
  const Vec3 beyond[] = {{-1.2, 0, 1}, {1.2, 0, 1}, {0, -1.2, 1}, {0, 1.2, 1}, {-2, -2, 1}, {3, 3, 1}};
  std::vector<Feature> features(std::size(beyond));
  for (std::size_t i = 0; i < features.size(); ++i) {
    features[i].ray_x = static_cast<float>(beyond[i].x);
    features[i].ray_y = static_cast<float>(beyond[i].y);
  }
  Arena arena(test::kArenaBytes);
  FeatureGrid grid(arena, features.size(), kCamera);
  grid.build(features);
  for (std::size_t i = 0; i < features.size(); ++i) {
    int visits = 0;
    grid.for_each_near(grid.u_of(features[i]) + 1, grid.v_of(features[i]) - 1, 2, [&](std::size_t k) {
      EXPECT_EQ(k, i);
      ++visits;
    });
    EXPECT_EQ(visits, 1) << i;
  }
}

TEST(FeatureGrid, ARebuildForgetsTheLastFrame) {
  const std::vector<Feature> many = scattered(1000, 1), few = scattered(3, 1);
  Arena arena(test::kArenaBytes);
  FeatureGrid grid(arena, many.size(), kCamera);
  grid.build(many);
  grid.build(few);
  int visits = 0;
  grid.for_each_near(320, 240, 5000, [&](std::size_t) { ++visits; });
  EXPECT_EQ(visits, 3);
  grid.build({});
  grid.for_each_near(320, 240, 5000, [&](std::size_t) { ++visits; });
  EXPECT_EQ(visits, 3);
}

TEST(FeatureGrid, AllInOneCell) {
  std::vector<Feature> features(1200);
  Arena arena(test::kArenaBytes);
  FeatureGrid grid(arena, features.size(), kCamera);
  grid.build(features);
  int visits = 0;
  grid.for_each_near(kCamera.cx, kCamera.cy, 0.5, [&](std::size_t) { ++visits; });
  EXPECT_EQ(visits, 1200);
}

}  // namespace
}  // namespace stillmap
