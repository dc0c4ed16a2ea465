// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/fixed_vector.h"
#include "track/local_map.h"

namespace stillmap {

/// One keyframe's look at one point.
struct WindowObservation {
  std::uint16_t view = 0;   ///< index into AdjustmentWindow::views
  std::uint16_t point = 0;  ///< index into AdjustmentWindow::points
  float ray_x = 0, ray_y = 0, sigma_px = 1;
  float depth_m = 0, sigma_depth_m = 0;  ///< depth 0: none
};

/// A keyframe of the window.
struct WindowView {
  std::uint32_t keyframe_id = 0;
  std::uint16_t keyframe_slot = 0;
  bool fixed = false;  ///< holds the window in its place, is not moved itself
  Pose T_camera_odom;
};

struct WindowPoint {
  PointRef ref;
  Vec3 p_odom;
  /// What frames between the keyframes have told of it; `information` as in MapPoint.
  Vec3 p_odom_fused = p_odom;
  Symmetric3 information{};
};

/// A copy of the part of the local map that is adjusted together, so that it can be worked on while the map
/// goes on.
struct AdjustmentWindow {
  static constexpr std::size_t kViews = 16, kFreeViews = 8, kPoints = 1500, kObservations = 9000;
  explicit AdjustmentWindow(Arena& arena)
      : points(arena.take<WindowPoint>("window.points", kPoints)),
        observations(arena.take<WindowObservation>("window.observations", kObservations)) {}

  FixedVector<WindowView, kViews> views;  ///< those that are free first, the newest at the front
  ArenaVector<WindowPoint> points;
  ArenaVector<WindowObservation> observations;  ///< in any order; adjusting groups them by point
  double cost_before = 0, cost_after = 0;       ///< sums of the robust squared whitened residuals
};

/// Adjusts the window's free poses and points together: Levenberg-Marquardt over reprojection and depth, the
/// points eliminated by the Schur complement (Triggs et al., "Bundle Adjustment: A Modern Synthesis", 1999,
/// section 6), Huber weights as in `solve_pose`. Each point is also held to where all its looks fused have
/// put it: keyframes alone would forget nine frames of ten. The cost never ends above where it began. No
/// heap; any one thread.
class WindowAdjuster {
 public:
  WindowAdjuster(Arena& arena, const CameraModel& camera);
  void adjust(AdjustmentWindow& window);

 private:
  CameraModel camera_;
  std::span<Vec3> tried_points_;
};

}  // namespace stillmap
