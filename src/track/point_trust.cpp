// SPDX-License-Identifier: Apache-2.0
#include "track/point_trust.h"

#include <algorithm>

namespace stillmap {

namespace {

// A point is trusted in full after this many looks; before, it may sit on something that has only just come
// in.
constexpr double kLooksToTrust = 6;
constexpr double kLeastWeight = 0.15;
// A suspect point has proved that it stands still when it was found again in its place after this long, a
// walker's step, and in this share of the looks.
constexpr Nanoseconds kTimeToProve_ns = 200'000'000;
constexpr int kLooksToProve = 2;
constexpr double kFoundToProve = 0.6;
// A point of the still world that was found this often vouches for a feature that the mask holds for a
// mover's.
constexpr int kLooksToVouch = 4;
constexpr double kVouchedWeight = 0.4;
// With fewer matches that count the pose is starved: people cover the view, or it is new. What is suspect,
// but not seen to move, is taken back then with little weight, and the motion model has its say.
constexpr std::ptrdiff_t kEnoughToStandOn = 100;
constexpr double kReadmittedWeight = 0.1;

}  // namespace

double trust_in(const MapPoint& point, Label label, Nanoseconds stamp_ns) {
  if (point.suspect) {
    const bool proved = stamp_ns - point.made_ns >= kTimeToProve_ns && point.found >= kLooksToProve &&
                        point.found >= kFoundToProve * point.visible;
    return proved ? kVouchedWeight : 0;
  }
  if (label == Label::Dynamic || label == Label::Unknown)
    return point.found >= kLooksToVouch ? kVouchedWeight : 0;
  return std::clamp(point.found / kLooksToTrust, kLeastWeight, 1.0);
}

bool readmit_if_starved(std::span<PoseObservation> observations, std::span<const std::uint16_t> feature_of,
                        std::span<const Feature> features) {
  const auto counts = std::count_if(observations.begin(), observations.end(),
                                    [](const PoseObservation& o) { return o.weight > 0; });
  if (counts >= kEnoughToStandOn) return false;
  for (std::size_t k = 0; k < observations.size(); ++k) {
    const bool moves = features[feature_of[k]].label == Label::Dynamic;
    if (observations[k].weight <= 0 && !moves) observations[k].weight = kReadmittedWeight;
  }
  return true;
}

}  // namespace stillmap
