// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/config.h"
#include "core/fixed_vector.h"
#include "core/random.h"
#include "track/feature_extractor.h"
#include "track/local_map.h"
#include "track/place_index.h"
#include "track/view_matcher.h"

namespace stillmap {

/// Slots of keyframes.
using PlacesToTry = FixedVector<std::size_t, 2>;
/// At which keyframes to look for a lost camera: those it most resembles (`candidates`, best first), and no
/// two that were made right after one another. They show nearly the same: where people stand before one, they
/// do before the other, and comparing takes half as long as all else of a frame.
PlacesToTry places_to_try(std::span<const PlaceCandidate> candidates, std::span<const Keyframe> keyframes);

struct FoundPose {
  Pose T_camera_odom;
  bool sure = false;  ///< the view alone speaks for it, whatever has become of its points
};

/// Finds the camera's pose without a prediction, from one keyframe. Used by one thread; no heap after
/// construction.
class Relocalizer {
 public:
  Relocalizer(Arena& arena, const Config::Track& config, const CameraModel& camera);

  /// What is asked for until the next call. Features that move, or may, have no say.
  void take(const FrameFeatures& frame);
  /// Where the camera is, to be confirmed by a guided search; or nothing.
  std::optional<FoundPose> find_by(const Keyframe& keyframe, Random random);

 private:
  ViewMatcher matcher_;
  std::span<Keyframe> frame_;  // one; none while memory is planned
};

}  // namespace stillmap
