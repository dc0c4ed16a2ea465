// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/tracking_result.h"
#include "track/feature_extractor.h"
#include "track/feature_grid.h"
#include "track/projection_matcher.h"

namespace stillmap {

/// Finds features that move against the still world by geometry alone: movers whose class no network knows,
/// people that it misses, and every mover when there is no model.
///
/// Each feature with depth is looked for where it was some frames ago, had it stood still; when it is found
/// elsewhere by more than its uncertainty, it moves. Single verdicts are noisy, so neighbours in the picture
/// and in depth vote. Keeps the last frames. Used by one thread; no heap after construction.
class MotionCheck {
 public:
  MotionCheck(Arena& arena, const CameraModel& camera, std::size_t feature_capacity);

  /// Relabels Static features of `frame`, which `grid` indexes, that move as Dynamic. Features that stand on
  /// a map point (`inliers`) are still by that. When most features would move, it may as well be the pose
  /// that is wrong: what is not on a point is Unknown then.
  void relabel(FrameFeatures& frame, const FeatureGrid& grid, std::span<const FeatureMatch> inliers,
               Nanoseconds stamp_ns, const Pose& T_odom_camera, const FeatureExtractor& extractor);
  /// Keeps the frame for later ones.
  void remember(const FrameFeatures& frame, Nanoseconds stamp_ns, const Pose& T_odom_camera);
  /// Forgets all frames: for when poses no longer connect.
  void clear() { count_ = 0; }

 private:
  enum class Verdict : std::uint8_t { Unknown, Still, Moving };
  struct Past {
    FeatureGrid grid;
    Nanoseconds stamp_ns = 0;
    Pose T_odom_camera{};
  };
  Verdict verdict_of(const Feature& feature, const Descriptor& descriptor, const Past& past,
                     const Pose& T_past_current, const FeatureExtractor& extractor) const;
  bool neighbours_move(const FeatureGrid& grid, const Feature& feature) const;

  static constexpr std::size_t kFrames = 3;
  CameraModel camera_;
  std::array<Past, kFrames> past_;
  std::size_t next_ = 0, count_ = 0;
  std::span<Verdict> verdicts_;
};

}  // namespace stillmap
