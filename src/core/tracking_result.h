// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "core/geometry.h"
#include "core/time.h"

namespace stillmap {

/// Initializing: no map yet. Tracking: enough inliers. Weak: above the floor, but not by much; or for a
/// moment (0.2 s at most) by aligning the picture as a whole, with no inliers. Lost: below the floor; the
/// pose is only predicted and is never published as one.
enum class TrackState : std::uint8_t { Initializing, Tracking, Weak, Lost };
const char* to_string(TrackState state);

struct LabelCounts {
  std::uint32_t static_points = 0, dynamic = 0, semi_static = 0, unknown = 0;
};

/// The tracker's word on one frame, with its own quality. Frames: map -> odom -> camera. odom is smooth: what
/// is adjusted among the newest keyframes moves it by a millimetre or so; a correction moves T_map_odom and
/// raises the epoch. Only who was lost is found elsewhere.
struct TrackingResult {
  std::uint64_t sequence = 0;
  Nanoseconds stamp_ns = 0;  ///< the frame's colour stamp
  TrackState state = TrackState::Initializing;
  Pose T_odom_camera;
  Pose T_map_odom;
  std::uint32_t correction_epoch = 0;
  std::uint32_t segment = 0;  ///< counts from 1; after a long loss a new one begins at a predicted pose
  std::uint32_t reference_keyframe =
      0;  ///< id of the keyframe that this pose hangs on: the newest, or the one it was found by
  bool is_keyframe = false;
  int features = 0, matches = 0, inliers = 0;
  double rms_px = 0;  ///< root mean square reprojection error of the inliers, at full resolution
  /// Of T_odom_camera's inverse: (rotation in rad, translation in m), left-multiplied in the camera frame,
  /// row-major; what 90 % of the errors over one second lie within.
  std::array<double, 36> covariance{};
  LabelCounts labels;

  Pose T_map_camera() const { return T_map_odom * T_odom_camera; }
  bool has_pose() const { return state == TrackState::Tracking || state == TrackState::Weak; }
  /// What may enter a map: not what only bridges a moment.
  bool stands_on_points() const { return has_pose() && inliers > 0; }
};

}  // namespace stillmap
