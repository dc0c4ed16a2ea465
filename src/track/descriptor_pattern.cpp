// SPDX-License-Identifier: Apache-2.0
#include "track/descriptor_pattern.h"

#include <cmath>
#include <numbers>

#include "core/random.h"

namespace stillmap {

namespace {

struct Point {
  double x, y;
};

Point gaussian_point(Random& random) {
  constexpr double kSigma = 6.2;  // 31 px / 5, the paper's choice
  while (true) {
    const double radius = kSigma * std::sqrt(-2 * std::log(1 - random.uniform()));
    const double angle = 2 * std::numbers::pi * random.uniform();
    if (radius <= DescriptorPattern::kRadius) return {radius * std::cos(angle), radius * std::sin(angle)};
  }
}

}  // namespace

DescriptorPattern::DescriptorPattern() {
  Random random(
      0x5711);  // part of the descriptor's definition: a new value makes saved descriptors unreadable
  constexpr double kShortest = 4;  // a shorter pair compares nearly the same smoothed pixels
  for (std::size_t bit = 0; bit < kBits; ++bit) {
    Point a = gaussian_point(random), b = gaussian_point(random);
    while (std::hypot(a.x - b.x, a.y - b.y) < kShortest) b = gaussian_point(random);
    for (std::size_t i = 0; i < kOrientations; ++i) {
      const double angle = 2 * std::numbers::pi * static_cast<double>(i) / kOrientations;
      const double c = std::cos(angle), s = std::sin(angle);
      const auto turned = [](double v) { return static_cast<std::int8_t>(std::lround(v)); };
      turned_[i][bit] = {turned(c * a.x - s * a.y), turned(s * a.x + c * a.y), turned(c * b.x - s * b.y),
                         turned(s * b.x + c * b.y)};
    }
  }
}

const DescriptorPattern::Pairs& DescriptorPattern::at_angle(float angle_rad) const {
  const auto index = std::lround(static_cast<double>(angle_rad) / (2 * std::numbers::pi) * kOrientations);
  return turned_[static_cast<std::size_t>((index % kOrientations + kOrientations) % kOrientations)];
}

}  // namespace stillmap
