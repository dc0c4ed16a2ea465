// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "core/absolute_orientation.h"
#include "core/geometry.h"
#include "core/random.h"

namespace stillmap {

/// One point, seen from two places.
struct PointPair {
  Vec3 from, to;
  double tolerance_m = 0;  ///< `to`'s part in how far a distance between two points may differ
};

/// The rigid motion that most speaks for, though most pairs may be wrong: three-point absolute orientation in
/// RANSAC (Fischler and Bolles, CACM 24(6), 1981). `pair_at(i)` is pair i of `pairs`; `share_of(T_to_from)`,
/// from 0 to 1, says how much agrees with a motion. Nothing where none has more than `share_to_beat`. At most
/// `samples` are drawn, as many fewer as the share allows. No heap; any thread.
template <class PairAt, class ShareOf>
std::optional<Pose> rigid_consensus(std::size_t pairs, int samples, double share_to_beat, Random& random,
                                    PairAt pair_at, ShareOf share_of) {
  constexpr double kShortest_m = 0.1;  // between two points of a sample
  constexpr int kFewestSamples = 20;
  std::optional<Pose> best;
  double share = share_to_beat, enough = samples;
  for (int round = 0; round < enough; ++round) {
    std::array<Vec3, 3> from, to;
    std::array<double, 3> tolerance;
    for (std::size_t i = 0; i < 3; ++i) {
      const PointPair pair = pair_at(random.below(static_cast<std::uint32_t>(pairs)));
      from[i] = pair.from;
      to[i] = pair.to;
      tolerance[i] = pair.tolerance_m;
    }
    // A rigid motion keeps lengths: most wrong samples end here.
    bool rigid = true;
    for (std::size_t i = 0; i < 3 && rigid; ++i) {
      const std::size_t j = (i + 1) % 3;
      const double before = norm(from[i] - from[j]), after = norm(to[i] - to[j]);
      rigid = before > kShortest_m && std::abs(before - after) < tolerance[i] + tolerance[j];
    }
    if (!rigid) continue;
    const AbsoluteOrientation by_sample = absolute_orientation(from, to);
    if (!by_sample.unique) continue;
    if (const double found = share_of(by_sample.T_to_from); found > share) {
      share = found;
      best = by_sample.T_to_from;
      // So many samples that one in a hundred searches has none of three right pairs.
      enough = std::min<double>(samples, kFewestSamples + 4.6 / std::pow(share, 3));
    }
  }
  return best;
}

}  // namespace stillmap
