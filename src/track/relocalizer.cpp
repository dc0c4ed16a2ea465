// SPDX-License-Identifier: Apache-2.0
#include "track/relocalizer.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>

namespace stillmap {

namespace {

constexpr int kFewestAgreeing = 10, kFewestInliers = 20;
constexpr int kNeighbours = 2;  // keyframes apart, at most

}  // namespace

PlacesToTry places_to_try(std::span<const PlaceCandidate> candidates, std::span<const Keyframe> keyframes) {
  PlacesToTry places;
  for (const PlaceCandidate& candidate : candidates) {
    const auto is_neighbour = [&](std::size_t slot) {
      const auto apart = static_cast<std::int32_t>(keyframes[slot].id - keyframes[candidate.slot].id);
      return std::abs(apart) <= kNeighbours;
    };
    if (std::ranges::any_of(places, is_neighbour)) continue;
    if (!places.try_push_back(candidate.slot)) break;
  }
  return places;
}

Relocalizer::Relocalizer(Arena& arena, const Config::Track& config, const CameraModel& camera)
    : matcher_(arena, config, camera), frame_(arena.take<Keyframe>("relocalizer.frame", 1)) {}

void Relocalizer::take(const FrameFeatures& frame) {
  Keyframe& own = frame_.front();
  own.features.clear();
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    const Feature& f = frame.features[i];
    const bool stands = f.label == Label::Static || f.label == Label::SemiStatic;
    own.descriptors[i] = frame.descriptors[i];
    if (!own.features.try_push_back({f.ray_x, f.ray_y, stands ? f.depth_m : 0, f.octave, {}})) return;
  }
}

std::optional<FoundPose> Relocalizer::find_by(const Keyframe& keyframe, Random random) {
  const std::optional<ViewMatch> match = matcher_.match(frame_.front(), keyframe, random);
  if (!match || match->agreeing_pairs < kFewestAgreeing || match->inliers < kFewestInliers)
    return std::nullopt;
  return FoundPose{match->T_a_b * inverse(keyframe.T_odom_camera), match->is_convincing()};
}

}  // namespace stillmap
