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
#include "track/pose_solver.h"

namespace stillmap {

/// Finds the camera's pose without a prediction, from one keyframe's points: descriptors are compared all
/// with all, three-point absolute orientation (Horn, JOSA A 4(4), 1987) in RANSAC over features with depth,
/// then a robust solve. Used by one thread; no heap after construction.
class Relocalizer {
 public:
  Relocalizer(Arena& arena, const Config::Track& config, const CameraModel& camera);
  /// T_camera_odom with at least `track.min_inliers` / 2 inliers, to be confirmed by a guided search; or
  /// nothing.
  std::optional<Pose> relocalize(LocalMap& map, const Keyframe& keyframe, const FrameFeatures& frame,
                                 const FeatureExtractor& extractor, Random random);

 private:
  struct Pair {
    std::uint16_t feature, keyframe_feature;
    Vec3 p_camera, p_odom;
  };
  void find_pairs(LocalMap& map, const Keyframe& keyframe, const FrameFeatures& frame);
  int count_inliers(const Pose& T_camera_odom, const FrameFeatures& frame,
                    const FeatureExtractor& extractor) const;

  CameraModel camera_;
  int fewest_inliers_;
  ArenaVector<Pair> pairs_;
  ArenaVector<PoseObservation> observations_;
};

/// The rigid transform that takes `from` to `to` best in the sense of least squares (Horn 1987). At least
/// three points that are not in a line; nothing otherwise.
std::optional<Pose> absolute_orientation(std::span<const Vec3> from, std::span<const Vec3> to);

}  // namespace stillmap
