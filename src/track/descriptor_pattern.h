// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

namespace stillmap {

/// The point pairs that make a descriptor's bits, turned to every orientation beforehand.
///
/// The pairs are drawn from a seeded generator as in BRIEF (Calonder et al., ECCV 2010, G II: both ends
/// Gaussian around the centre), inside a circle of radius 13 px so that no turn leaves the patch.
class DescriptorPattern {
 public:
  static constexpr int kBits = 256, kOrientations = 64, kRadius = 13;
  struct Pair {
    std::int8_t x0, y0, x1, y1;
  };
  using Pairs = std::array<Pair, kBits>;

  DescriptorPattern();
  /// The pattern turned by the nearest of 64 angles.
  const Pairs& at_angle(float angle_rad) const;

 private:
  std::array<Pairs, kOrientations> turned_;
};

}  // namespace stillmap
