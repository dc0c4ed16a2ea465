// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/camera.h"
#include "core/config.h"
#include "core/frame_pool.h"
#include "track/feature_extractor.h"
#include "track/local_map.h"
#include "track/projection_matcher.h"

namespace stillmap {

/// What is known of a posed frame when it goes into the map.
struct PosedFeatures {
  const FrameFeatures& frame;
  std::span<FeatureMatch> inliers;  ///< per feature the point it stands on; new points are written into it
  Pose T_odom_camera;
  std::uint64_t sequence;
  Nanoseconds stamp_ns;
};

/// Grows and mends the local map. Used by the tracker's thread; no heap.
class MapBuilder {
 public:
  MapBuilder(const Config::Track& config, const CameraModel& camera) : config_(config), camera_(camera) {}

  /// Makes the frame a keyframe, with new points for static features that have depth and no point.
  Keyframe& insert_keyframe(LocalMap& map, const PosedFeatures& posed,
                            const FeatureExtractor& extractor) const;
  /// Makes those of a keyframe's points anew that the map has given up, where the keyframe itself saw them,
  /// as if frame `sequence` had found them. Nobody remembers whether they stood still: they have to prove it.
  void revive_points(LocalMap& map, Keyframe& keyframe, std::uint64_t sequence,
                     const FeatureExtractor& extractor) const;
  /// Takes each inlier's measurement into its point: the mean weighted by information.
  void refine_points(LocalMap& map, const PosedFeatures& posed, const FeatureExtractor& extractor) const;
  /// Removes points that are rarely found where they should be seen.
  void cull_points(LocalMap& map) const;

 private:
  bool enters_map(const Feature& feature) const;
  MapPoint new_point(const Keyframe& keyframe, const KeyframeFeature& f, const Descriptor& descriptor,
                     const FeatureExtractor& extractor) const;
  Config::Track config_;
  CameraModel camera_;
};

/// Variance of a point's position along a unit direction, from its information matrix.
double variance_along(const MapPoint& point, Vec3 direction);

}  // namespace stillmap
