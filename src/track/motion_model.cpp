// SPDX-License-Identifier: Apache-2.0
#include "track/motion_model.h"

#include <algorithm>
#include <cmath>

namespace stillmap {

namespace {

constexpr double kShort_s = 0.1;  // two frames' motion says nothing of what is further ahead

}  // namespace

void MotionModel::posed(Nanoseconds stamp_ns, const Pose& T_odom_camera) {
  past_[1] = past_[0];
  past_[0] = {stamp_ns, T_odom_camera};
  size_ = std::min(size_ + 1, 2);
}

void MotionModel::move(const Pose& T_after_before) {
  for (PosedStamp& posed : past_) posed.T_odom_camera = T_after_before * posed.T_odom_camera;
}

CameraSpeed MotionModel::speed_to(Nanoseconds stamp_ns, const Pose& T_odom_camera) const {
  if (size_ == 0) return {};
  return speed_between(past_[0].T_odom_camera, T_odom_camera, seconds_since_pose(stamp_ns));
}

std::optional<PosePrior> MotionModel::told(Nanoseconds stamp_ns) {
  if (size_ == 0) return std::nullopt;
  const std::optional<MotionDelta> motion = odometry_.between(past_[0].stamp_ns, stamp_ns);
  if (!motion) return std::nullopt;
  const Pose T_before_now = inverse(T_base_camera_) * motion->T_from_to * T_base_camera_;
  // A base that turns carries its camera along an arc.
  const double lever_m = norm(T_base_camera_.t);
  return PosePrior{inverse(past_[0].T_odom_camera * T_before_now), motion->sigma_rotation_rad,
                   std::hypot(motion->sigma_translation_m, lever_m * motion->sigma_rotation_rad)};
}

std::optional<Pose> MotionModel::predict(Nanoseconds stamp_ns) {
  if (size_ == 0) return std::nullopt;
  if (const std::optional<PosePrior> by_odometry = told(stamp_ns))
    return inverse(by_odometry->T_camera_world);
  const PosedStamp& newest = past_[0];
  if (size_ == 1) return newest.T_odom_camera;
  const double span = to_seconds(newest.stamp_ns - past_[1].stamp_ns);
  if (span <= 0) return newest.T_odom_camera;  // a stamp that came twice, or a clock that was set back
  // Beyond a few frames an old velocity says nothing any more.
  const double ahead = to_seconds(stamp_ns - newest.stamp_ns);
  const double share = std::clamp(ahead / span, -1.0, 3.0);
  const Pose step = inverse(past_[1].T_odom_camera) * newest.T_odom_camera;
  return newest.T_odom_camera * interpolate(Pose{}, step, share);
}

/// The constant velocity's trust in itself: what a hand that jerks does to it in this time.
PosePrior MotionModel::as_before(Nanoseconds stamp_ns) {
  const double seconds = seconds_since_pose(stamp_ns);
  return {inverse(*predict(stamp_ns)), 0.003 + 10 * seconds * seconds, 0.003 + 2 * seconds * seconds};
}

std::optional<PosePrior> MotionModel::prior(Nanoseconds stamp_ns) {
  std::optional<PosePrior> by_odometry = told(stamp_ns);
  if (by_odometry || size_ < 2 || seconds_since_pose(stamp_ns) > kShort_s) return by_odometry;
  return as_before(stamp_ns);
}

PosePrior MotionModel::step(Nanoseconds stamp_ns) {
  const std::optional<PosePrior> by_odometry = told(stamp_ns);
  PosePrior step = by_odometry ? *by_odometry : as_before(stamp_ns);
  step.T_camera_world = step.T_camera_world * past_[0].T_odom_camera;
  return step;
}

}  // namespace stillmap
