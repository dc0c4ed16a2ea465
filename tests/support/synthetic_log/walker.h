// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "tests/support/synthetic_log/camera_path.h"
#include "tests/support/synthetic_log/shape.h"

namespace stillmap::synthetic {

/// A person in a safety vest who walks around the room's table, and passes the camera's azimuth at a seeded
/// time.
class Walker {
 public:
  Walker(std::uint64_t seed, int index, const CameraPath& camera);
  /// Appends the body at time `t_s`.
  void add_shapes(double t_s, std::vector<Shape>& shapes) const;

 private:
  Vec3 position(double t_s) const;
  void add_leg(const Pose& T_world_body, double side, double gait_rad, std::vector<Shape>& shapes) const;
  void add_arm(const Pose& T_world_body, double side, double gait_rad, std::vector<Shape>& shapes) const;
  void add_trunk(const Pose& T_world_body, double gait_rad, std::vector<Shape>& shapes) const;
  Shape part(ShapeKind kind, const Pose& T_world_body, Vec3 center, Vec3 half, int material) const;
  Shape limb(const Pose& T_world_body, Vec3 from, Vec3 to, double radius, int material) const;

  std::uint8_t id_ = 1;
  double size_ = 1;         ///< of 1.75 m
  double radius_m_ = 1.4;   ///< of the way around the table
  double meeting_rad_ = 0;  ///< azimuth at meeting_s_
  double meeting_s_ = 0;
  double speed_rad_s_ = 0.6;  ///< signed
  double phase_rad_ = 0;
  float trousers_tint_ = 1, shirt_tint_ = 1, helmet_tint_ = 1;
};

}  // namespace stillmap::synthetic
