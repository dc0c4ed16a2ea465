// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/config.h"
#include "track/epipolar.h"
#include "track/feature_extractor.h"
#include "track/feature_grid.h"
#include "track/projection_matcher.h"

namespace stillmap {

/// Decides for features of semi-static things (a chair, a cup) whether the thing moves right now: the seed
/// paper's epipolar test between the previous frame and this one. Keeps the previous frame. Used by one
/// thread; no heap after construction.
class SemiStaticCheck {
 public:
  SemiStaticCheck(Arena& arena, const Config::Track& config, const CameraModel& camera,
                  std::size_t feature_capacity);

  /// Relabels SemiStatic features of `frame`: Dynamic when farther than `track.epipolar_threshold_px` from
  /// their epipolar line, Static when nearer, unchanged where nothing can be said: too few static
  /// correspondences, no counterpart in the previous frame, or a camera that only turned (then every F fits).
  /// `inliers[i]`: the map point that feature i stands on, slot -1 for none. `T_previous_current` is the
  /// camera's motion.
  void relabel(FrameFeatures& frame, std::span<const FeatureMatch> inliers, const Pose& T_previous_current,
               Random random);
  /// Keeps `frame` for the next call.
  void remember(const FrameFeatures& frame, std::span<const FeatureMatch> inliers);

 private:
  Vec2 ideal_pixel(const Feature& f) const {
    return {camera_.fx * f.ray_x + camera_.cx, camera_.fy * f.ray_y + camera_.cy};
  }
  void collect_static(const FrameFeatures& frame, std::span<const FeatureMatch> inliers);
  double median_parallax_px(const Pose& T_previous_current);
  int counterpart(const Feature& feature, const Descriptor& descriptor, const Pose& T_previous_current) const;

  CameraModel camera_;
  double threshold_px_;
  FrameFeatures previous_;
  FeatureGrid previous_grid_;
  std::span<std::int32_t> previous_feature_of_slot_;
  ArenaVector<FeatureMatch> previous_matches_;
  ArenaVector<Correspondence> static_pairs_;
  std::span<double> parallax_;
};

}  // namespace stillmap
