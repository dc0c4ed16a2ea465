// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <optional>

#include "track/odometry_source.h"
#include "track/pose_covariance.h"
#include "track/pose_solver.h"

namespace stillmap {

/// Where the camera will be, by where it was: as the robot's odometry tells it, else as if it went on moving
/// as it did. Holds the last two posed frames. The tracker's thread; only `odometry` is shared. No heap.
class MotionModel {
 public:
  /// `T_base_camera`: where the camera sits on the robot, for what its odometry says of the base.
  explicit MotionModel(const Pose& T_base_camera) : T_base_camera_(T_base_camera) {}
  OdometrySource& odometry() { return odometry_; }

  /// A frame has been posed.
  void posed(Nanoseconds stamp_ns, const Pose& T_odom_camera);
  /// A frame has not: what is known of the speed is gone.
  void lost() { size_ = std::min(size_, 1); }
  /// odom's newest poses have been corrected.
  void move(const Pose& T_after_before);

  bool has_pose() const { return size_ > 0; }
  /// T_odom_camera of the last posed frame; call it only where there is one.
  const Pose& last() const { return past_[0].T_odom_camera; }
  double seconds_since_pose(Nanoseconds stamp_ns) const { return to_seconds(stamp_ns - past_[0].stamp_ns); }
  CameraSpeed speed_to(Nanoseconds stamp_ns, const Pose& T_odom_camera) const;

  /// T_odom_camera at `stamp_ns`; nothing before the first posed frame.
  std::optional<Pose> predict(Nanoseconds stamp_ns);
  /// T_camera_odom at `stamp_ns` by the robot's own account, from the last posed frame on.
  std::optional<PosePrior> told(Nanoseconds stamp_ns);
  /// The same by the robot's account or by two frames' motion, where either reaches that far.
  std::optional<PosePrior> prior(Nanoseconds stamp_ns);
  /// From the last posed frame to `stamp_ns`, T_camera_now_before; call it only where there is one.
  PosePrior step(Nanoseconds stamp_ns);

 private:
  struct PosedStamp {
    Nanoseconds stamp_ns = 0;
    Pose T_odom_camera;
  };
  PosePrior as_before(Nanoseconds stamp_ns);

  Pose T_base_camera_;
  OdometrySource odometry_;
  std::array<PosedStamp, 2> past_;  // the newest first
  int size_ = 0;
};

}  // namespace stillmap
