// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_log/camera_path.h"

#include <cmath>

#include "tests/support/synthetic_log/random.h"
#include "tests/support/synthetic_log/shape.h"

namespace stillmap::synthetic {

namespace {
enum Channel : int {
  kRadius,
  kHeight,
  kAlong,
  kTargetX,
  kTargetY,
  kTargetZ,
  kTiltX,
  kTiltY,
  kTiltZ,
  kYaw,
  kPitch,
  kRoll
};
}

CameraPath::CameraPath(std::uint64_t seed, PathKind kind) : kind_(kind) {
  Random random(seed, 3);
  start_rad_ = random.uniform(0, 2 * M_PI);
  direction_ = random.sign();
  for (std::size_t c = 0; c < phase_rad_.size(); ++c) {
    for (std::size_t w = 0; w < phase_rad_[c].size(); ++w) {
      phase_rad_[c][w] = random.uniform(0, 2 * M_PI);
      rate_rad_s_[c][w] = 2 * M_PI * (w < 3 ? random.uniform(0.08, 0.4) : random.uniform(1.2, 2.6));
    }
  }
}

double CameraPath::sway(int channel, double t_s, double tremor) const {
  const auto c = static_cast<std::size_t>(channel);
  double sum = 0;
  for (std::size_t w = 0; w < kWaves; ++w) {
    const double weight = w < 3 ? 1.0 / 3 : tremor / 2;
    sum += weight * std::sin(rate_rad_s_[c][w] * t_s + phase_rad_[c][w]);
  }
  return sum;
}

double CameraPath::azimuth_rad(double t_s) const {
  const double rate_rad_s = kind_ == PathKind::Orbit ? 0.2 : kind_ == PathKind::Walk ? 0.3 : 0;
  return start_rad_ + direction_ * rate_rad_s * t_s;
}

Vec3 CameraPath::position(double t_s) const {
  const double angle = azimuth_rad(t_s) + 0.05 * sway(kAlong, t_s, 0.03),
               radius = 2.35 + 0.15 * sway(kRadius, t_s, 0.03);
  return {kStretch * radius * std::cos(angle), radius * std::sin(angle),
          1.45 + 0.2 * sway(kHeight, t_s, 0.04)};
}

Vec3 CameraPath::target(double t_s) const {
  const Vec3 wander{0.5 * sway(kTargetX, t_s, 0), 0.5 * sway(kTargetY, t_s, 0), 0.3 * sway(kTargetZ, t_s, 0)};
  if (kind_ != PathKind::Walk) return Vec3{0, 0, 1.0} + wander;
  const double ahead = azimuth_rad(t_s) + direction_ * 1.0;
  return Vec3{kStretch * 1.9 * std::cos(ahead), 1.9 * std::sin(ahead), 1.15} + wander;
}

Pose CameraPath::T_world_camera(double t_s) const {
  const Vec3 at = position(t_s), forward = normalized(target(t_s) - at);
  // Camera axes: x right, y down, z forward; a down direction is the best guess for y.
  const Vec3 right = normalized(cross(forward, {0, 0, 1})), down = cross(forward, right);
  const Mat3 level{{right.x, down.x, forward.x, right.y, down.y, forward.y, right.z, down.z, forward.z}};
  Vec3 tilt_rad{0.03 * sway(kTiltX, t_s, 0.25), 0.03 * sway(kTiltY, t_s, 0.25),
                0.06 * sway(kTiltZ, t_s, 0.1)};
  if (kind_ == PathKind::Rotate) {
    tilt_rad =
        tilt_rad + Vec3{0.25 * sway(kPitch, t_s, 0), 0.8 * sway(kYaw, t_s, 0), 0.45 * sway(kRoll, t_s, 0)};
  }
  return {level * exp_so3(tilt_rad), at};
}

}  // namespace stillmap::synthetic
