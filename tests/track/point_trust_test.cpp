// SPDX-License-Identifier: Apache-2.0
#include "track/point_trust.h"

#include <gtest/gtest.h>

#include <vector>

namespace stillmap {
namespace {

constexpr Nanoseconds kMs = 1'000'000;

MapPoint seen(std::uint16_t found, std::uint16_t visible, bool suspect = false) {
  MapPoint p;
  p.found = found;
  p.visible = visible;
  p.suspect = suspect;
  return p;
}

TEST(PointTrust, GrowsWithLooks) {
  EXPECT_DOUBLE_EQ(trust_in(seen(0, 1), Label::Static, 0), 0.15);
  EXPECT_DOUBLE_EQ(trust_in(seen(3, 3), Label::Static, 0), 0.5);
  EXPECT_DOUBLE_EQ(trust_in(seen(60, 60), Label::Static, 0), 1);
  EXPECT_DOUBLE_EQ(trust_in(seen(3, 3), Label::SemiStatic, 0), 0.5);
}

TEST(PointTrust, AnEstablishedPointVouchesForAMaskedFeature) {
  for (const Label label : {Label::Dynamic, Label::Unknown}) {
    EXPECT_EQ(trust_in(seen(3, 3), label, 0), 0);
    EXPECT_DOUBLE_EQ(trust_in(seen(4, 4), label, 0), 0.4);
  }
}

TEST(PointTrust, ASuspectPointCountsOnceItHasProvedThatItStandsStill) {
  EXPECT_EQ(trust_in(seen(8, 8, true), Label::Static, 199 * kMs), 0) << "a walker has not yet made a step";
  EXPECT_EQ(trust_in(seen(1, 1, true), Label::Static, 900 * kMs), 0) << "never found again";
  EXPECT_EQ(trust_in(seen(5, 10, true), Label::Static, 900 * kMs), 0)
      << "not found in its place often enough";
  EXPECT_DOUBLE_EQ(trust_in(seen(2, 2, true), Label::Static, 200 * kMs), 0.4);
}

struct Observed {
  std::vector<PoseObservation> observations;
  std::vector<Feature> features;
  std::vector<std::uint16_t> feature_of;

  void add(std::size_t count, double weight, Label label) {
    for (std::size_t i = 0; i < count; ++i) {
      feature_of.push_back(static_cast<std::uint16_t>(features.size()));
      features.emplace_back().label = label;
      observations.emplace_back().weight = weight;
    }
  }
  bool readmit() { return readmit_if_starved(observations, feature_of, features); }
  double weight(std::size_t i) const { return observations[i].weight; }
};

TEST(PointTrust, AStarvedFrameTakesBackWhatIsNotSeenToMove) {
  Observed seen;
  seen.add(99, 1, Label::Static);
  seen.add(1, 0, Label::Static);
  seen.add(1, 0, Label::Unknown);
  seen.add(1, 0, Label::Dynamic);
  EXPECT_TRUE(seen.readmit());
  EXPECT_EQ(seen.weight(98), 1);
  EXPECT_DOUBLE_EQ(seen.weight(99), 0.1);
  EXPECT_DOUBLE_EQ(seen.weight(100), 0.1);
  EXPECT_EQ(seen.weight(101), 0) << "what moves says nothing, however few there are";
}

TEST(PointTrust, AFrameWithEnoughTakesNothingBack) {
  Observed seen;
  seen.add(100, 0.15, Label::Static);
  seen.add(50, 0, Label::Static);
  EXPECT_FALSE(seen.readmit());
  EXPECT_EQ(seen.weight(120), 0);
}

}  // namespace
}  // namespace stillmap
