// SPDX-License-Identifier: Apache-2.0
#include "track/feature_grid.h"

#include <gtest/gtest.h>

#include <set>

#include "scene.h"

namespace stillmap {
namespace {

const CameraModel kCamera = synthetic::SyntheticLog::camera();

class FeatureGridTest : public testing::Test {
 protected:
  FrameFeatures with(std::span<const Feature> features) {
    FrameFeatures frame(arena, features.size());
    for (const Feature& f : features) {
      EXPECT_TRUE(frame.features.try_push_back(f));
      EXPECT_TRUE(frame.descriptors.try_push_back(test::random_descriptor(random)));
    }
    return frame;
  }
  Arena arena{test::kArenaBytes};
  FeatureGrid grid{arena, 1200, kCamera};
  Random random{4};
};

std::vector<Feature> scattered(std::size_t count, double spread) {
  Random random(9);
  std::vector<Feature> features(count);
  for (Feature& f : features) {
    f.octave = static_cast<std::uint8_t>(random.below(8));
    f.depth_m = static_cast<float>(random.uniform());
    // With spread > 1 some lie outside the picture, as undistorting does.
    f.ray_x = static_cast<float>((random.uniform() - 0.5) * spread * kCamera.width / kCamera.fx);
    f.ray_y = static_cast<float>((random.uniform() - 0.5) * spread * kCamera.height / kCamera.fy);
  }
  return features;
}

TEST_F(FeatureGridTest, FindsExactlyWhatBruteForceFinds) {
  const std::vector<Feature> features = scattered(1200, 1.3);
  const FrameFeatures frame = with(features);
  grid.build(frame);
  for (int trial = 0; trial < 500; ++trial) {
    const double u = random.uniform() * 900 - 130, v = random.uniform() * 700 - 110,
                 radius = random.uniform() * 80;
    const int octave = static_cast<int>(random.below(8));
    for (const Octaves octaves : {Octaves{}, beside(octave)}) {
      std::multiset<std::size_t> found, expected;
      grid.for_each_near(octaves, u, v, radius, [&](const FeatureGrid::Item& item) {
        found.insert(item.feature);
        EXPECT_EQ(item.octave, features[item.feature].octave);
        EXPECT_EQ(item.depth_m, features[item.feature].depth_m);
        EXPECT_EQ(item.descriptor.bits, frame.descriptors[item.feature].bits);
      });
      for (std::size_t i = 0; i < features.size(); ++i) {
        const double du = grid.u_of(features[i]) - u, dv = grid.v_of(features[i]) - v;
        if (du * du + dv * dv <= radius * radius && features[i].octave >= octaves.first &&
            features[i].octave <= octaves.last)
          expected.insert(i);
      }
      ASSERT_EQ(found, expected) << u << ", " << v << " radius " << radius << " octave " << octave;
    }
  }
}

TEST_F(FeatureGridTest, FeaturesBeyondThePictureAreFound) {
  const Vec3 beyond[] = {{-1.2, 0, 1}, {1.2, 0, 1}, {0, -1.2, 1}, {0, 1.2, 1}, {-2, -2, 1}, {3, 3, 1}};
  std::vector<Feature> features(std::size(beyond));
  for (std::size_t i = 0; i < features.size(); ++i) {
    features[i].ray_x = static_cast<float>(beyond[i].x);
    features[i].ray_y = static_cast<float>(beyond[i].y);
  }
  grid.build(with(features));
  for (std::size_t i = 0; i < features.size(); ++i) {
    int visits = 0;
    grid.for_each_near({}, grid.u_of(features[i]) + 1, grid.v_of(features[i]) - 1, 2,
                       [&](const FeatureGrid::Item& item) {
                         EXPECT_EQ(item.feature, i);
                         ++visits;
                       });
    EXPECT_EQ(visits, 1) << i;
  }
}

TEST_F(FeatureGridTest, ARebuildForgetsTheLastFrame) {
  const auto visits = [&] {
    int count = 0;
    grid.for_each_near({}, 320, 240, 5000, [&](const FeatureGrid::Item&) { ++count; });
    return count;
  };
  grid.build(with(scattered(1000, 1)));
  grid.build(with(scattered(3, 1)));
  EXPECT_EQ(visits(), 3);
  grid.build(with({}));
  EXPECT_EQ(visits(), 0);
}

TEST_F(FeatureGridTest, AllInOneCell) {
  grid.build(with(std::vector<Feature>(1200)));
  int visits = 0;
  grid.for_each_near({}, kCamera.cx, kCamera.cy, 0.5, [&](const FeatureGrid::Item&) { ++visits; });
  EXPECT_EQ(visits, 1200);
}

}  // namespace
}  // namespace stillmap
