// SPDX-License-Identifier: Apache-2.0
#include "track/descriptor_pattern.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <tuple>

namespace stillmap {
namespace {

constexpr float kStep = static_cast<float>(2 * std::numbers::pi / DescriptorPattern::kOrientations);

TEST(DescriptorPattern, NoTurnLeavesThePatch) {
  const DescriptorPattern pattern;
  for (int i = 0; i < DescriptorPattern::kOrientations; ++i) {
    for (const auto& p : pattern.at_angle(static_cast<float>(i) * kStep)) {
      // The ends lie in the circle; rounding to whole pixels adds at most half a pixel in each direction.
      EXPECT_LE(std::hypot(p.x0, p.y0), DescriptorPattern::kRadius + 0.71);
      EXPECT_LE(std::hypot(p.x1, p.y1), DescriptorPattern::kRadius + 0.71);
      EXPECT_LE(std::max({std::abs(p.x0), std::abs(p.y0), std::abs(p.x1), std::abs(p.y1)}),
                DescriptorPattern::kRadius);
    }
  }
}

TEST(DescriptorPattern, TurningIsTurning) {
  const DescriptorPattern pattern;
  const auto& upright = pattern.at_angle(0);
  for (int i = 0; i < DescriptorPattern::kOrientations; ++i) {
    const double c = std::cos(static_cast<double>(i) * kStep), s = std::sin(static_cast<double>(i) * kStep);
    const auto& turned = pattern.at_angle(static_cast<float>(i) * kStep);
    for (std::size_t k = 0; k < turned.size(); ++k) {
      // Both are rounded: half a pixel each, and the rounding of the first is turned along.
      EXPECT_NEAR(turned[k].x0, c * upright[k].x0 - s * upright[k].y0, 1.25);
      EXPECT_NEAR(turned[k].y0, s * upright[k].x0 + c * upright[k].y0, 1.25);
      EXPECT_NEAR(turned[k].x1, c * upright[k].x1 - s * upright[k].y1, 1.25);
      EXPECT_NEAR(turned[k].y1, s * upright[k].x1 + c * upright[k].y1, 1.25);
    }
  }
}

TEST(DescriptorPattern, AQuarterTurnIsExact) {
  const DescriptorPattern pattern;
  const auto& upright = pattern.at_angle(0);
  const auto& turned = pattern.at_angle(static_cast<float>(std::numbers::pi / 2));
  for (std::size_t k = 0; k < turned.size(); ++k) {
    EXPECT_EQ(turned[k].x0, -upright[k].y0);
    EXPECT_EQ(turned[k].y0, upright[k].x0);
  }
}

TEST(DescriptorPattern, AnyAngleFindsItsNearestTurn) {
  const DescriptorPattern pattern;
  const auto pi = static_cast<float>(std::numbers::pi);
  EXPECT_EQ(&pattern.at_angle(-pi), &pattern.at_angle(pi));
  EXPECT_EQ(&pattern.at_angle(0.45f * kStep), &pattern.at_angle(0));
  EXPECT_EQ(&pattern.at_angle(-0.45f * kStep), &pattern.at_angle(0));
  EXPECT_EQ(&pattern.at_angle(0.55f * kStep), &pattern.at_angle(kStep));
  EXPECT_EQ(&pattern.at_angle(-kStep), &pattern.at_angle(2 * pi - kStep));
  EXPECT_EQ(&pattern.at_angle(4 * pi + kStep), &pattern.at_angle(kStep));
  EXPECT_NE(&pattern.at_angle(kStep), &pattern.at_angle(0));
}

TEST(DescriptorPattern, BitsDifferFromEachOther) {
  const DescriptorPattern pattern;
  std::set<std::tuple<int, int, int, int>> pairs;
  for (const auto& p : pattern.at_angle(0)) {
    EXPECT_GE(std::hypot(p.x0 - p.x1, p.y0 - p.y1), 2.5) << "a pair of nearly one pixel says nothing";
    pairs.insert({p.x0, p.y0, p.x1, p.y1});
  }
  EXPECT_GE(pairs.size(), 250u);
}

/// Saved descriptors are compared with new ones: the pattern is part of their meaning and must never change
/// unseen.
TEST(DescriptorPattern, IsTheSameForEver) {
  const DescriptorPattern pattern;
  std::uint64_t hash = 1469598103934665603ULL;
  for (int i = 0; i < DescriptorPattern::kOrientations; ++i) {
    for (const auto& p : pattern.at_angle(static_cast<float>(i) * kStep)) {
      for (const std::int8_t v : {p.x0, p.y0, p.x1, p.y1})
        hash = (hash ^ static_cast<std::uint8_t>(v)) * 1099511628211ULL;
    }
  }
  EXPECT_EQ(hash, 2568144205266345435u);
}

}  // namespace
}  // namespace stillmap
