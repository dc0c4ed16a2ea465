// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/config.h"
#include "core/random.h"
#include "track/feature_extractor.h"
#include "track/local_map.h"
#include "track/view_matcher.h"

namespace stillmap {

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
