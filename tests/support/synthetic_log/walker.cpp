// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_log/walker.h"

#include <algorithm>

#include "tests/support/synthetic_log/materials.h"

namespace stillmap::synthetic {

Walker::Walker(std::uint64_t seed, int index, const CameraPath& camera)
    : id_(static_cast<std::uint8_t>(index + 1)) {
  Random random(seed, 100 + static_cast<std::uint64_t>(index));
  size_ = random.uniform(0.93, 1.08);
  // Even ones walk on an inner ring against the camera's way, odd ones on an outer ring with it and faster.
  const bool outer = index % 2 == 1;
  radius_m_ = (outer ? 1.72 : 1.25) + random.uniform(-0.06, 0.06);
  meeting_s_ = 0.6 + 2.9 * index + random.uniform(0, 0.5);
  meeting_rad_ = camera.azimuth_rad(meeting_s_);
  speed_rad_s_ = camera.direction() * (outer ? random.uniform(0.68, 0.78) : -random.uniform(0.55, 0.75));
  phase_rad_ = random.uniform(0, 2 * M_PI);
  trousers_tint_ = static_cast<float>(random.uniform(0.7, 1.5));
  shirt_tint_ = static_cast<float>(random.uniform(0.6, 1.6));
  helmet_tint_ = static_cast<float>(random.uniform(0.5, 1.15));
}

Vec3 Walker::position(double t_s) const {
  const double angle =
      meeting_rad_ + speed_rad_s_ * (t_s - meeting_s_) + 0.08 * std::sin(0.8 * t_s + phase_rad_);
  const double radius = radius_m_ + 0.07 * std::sin(1.1 * t_s + 2 * phase_rad_);
  return {CameraPath::kStretch * radius * std::cos(angle), radius * std::sin(angle), 0};
}

Shape Walker::part(ShapeKind kind, const Pose& T_world_body, Vec3 center, Vec3 half, int material) const {
  Shape s;
  s.kind = kind;
  s.center = T_world_body * (size_ * center);
  s.axes = T_world_body.R;
  s.half = size_ * half;
  s.material = material;
  s.figure = id_;
  return s;
}

Shape Walker::limb(const Pose& T_world_body, Vec3 from, Vec3 to, double radius, int material) const {
  const Vec3 along = to - from;
  Shape s =
      part(ShapeKind::Capsule, T_world_body, 0.5 * (from + to), {radius, radius, norm(along) / 2}, material);
  s.axes = T_world_body.R * frame_along(along, {1, 0, 0.01});
  return s;
}

void Walker::add_leg(const Pose& T_world_body, double side, double gait_rad,
                     std::vector<Shape>& shapes) const {
  const double swing = 0.45 * std::sin(gait_rad), knee_bend = 0.12 + 0.6 * std::max(0.0, std::cos(gait_rad));
  const Vec3 hip{0, side * 0.095, 0.9};
  const Vec3 knee = hip + 0.42 * Vec3{std::sin(swing), 0, -std::cos(swing)};
  const double shin = swing - knee_bend;
  const Vec3 ankle = knee + 0.4 * Vec3{std::sin(shin), 0, -std::cos(shin)};
  shapes.push_back(limb(T_world_body, hip, knee, 0.082, kTrousers));
  shapes.push_back(limb(T_world_body, knee, ankle, 0.062, kTrousers));
  shapes[shapes.size() - 2].tint = shapes.back().tint = trousers_tint_;
  shapes.push_back(
      part(ShapeKind::Ellipsoid, T_world_body, ankle + Vec3{0.06, 0, -0.03}, {0.14, 0.055, 0.05}, kShoe));
}

void Walker::add_arm(const Pose& T_world_body, double side, double gait_rad,
                     std::vector<Shape>& shapes) const {
  const double swing = -0.5 * std::sin(gait_rad), elbow_bend = 0.35 + 0.2 * std::sin(gait_rad);
  const Vec3 shoulder{0.01, side * 0.215, 1.4};
  const Vec3 elbow = shoulder + 0.29 * Vec3{std::sin(swing), side * 0.12, -std::cos(swing)};
  const double fore = swing + elbow_bend;
  const Vec3 wrist = elbow + 0.25 * Vec3{std::sin(fore), 0, -std::cos(fore)};
  shapes.push_back(limb(T_world_body, shoulder, elbow, 0.056, kShirt));
  shapes.push_back(limb(T_world_body, elbow, wrist, 0.046, kShirt));
  shapes[shapes.size() - 2].tint = shapes.back().tint = shirt_tint_;
  shapes.push_back(
      part(ShapeKind::Ellipsoid, T_world_body, wrist + Vec3{0, 0, -0.05}, {0.05, 0.03, 0.075}, kSkin));
}

void Walker::add_trunk(const Pose& T_world_body, double gait_rad, std::vector<Shape>& shapes) const {
  const Pose twisted{T_world_body.R * yaw_rotation(0.12 * std::sin(gait_rad)), T_world_body.t};
  shapes.push_back(part(ShapeKind::Ellipsoid, T_world_body, {0, 0, 0.92}, {0.125, 0.165, 0.13}, kTrousers));
  shapes.back().tint = trousers_tint_;
  shapes.push_back(part(ShapeKind::Capsule, twisted, {0.01, 0, 1.17}, {0.13, 0.19, 0.17}, kVest));
  shapes.push_back(part(ShapeKind::Cylinder, twisted, {0.01, 0, 1.5}, {0.055, 0.055, 0.07}, kSkin));
  shapes.push_back(part(ShapeKind::Ellipsoid, T_world_body, {0.03, 0, 1.63}, {0.1, 0.08, 0.125}, kSkin));
  shapes.push_back(part(ShapeKind::Ellipsoid, T_world_body, {0.025, 0, 1.69}, {0.13, 0.105, 0.085}, kHelmet));
  shapes.back().tint = helmet_tint_;
}

void Walker::add_shapes(double t_s, std::vector<Shape>& shapes) const {
  const Vec3 at = position(t_s), travel = position(t_s + 0.01) - position(t_s - 0.01);
  const double gait_rad = 2 * M_PI * std::abs(speed_rad_s_) * radius_m_ * t_s / 1.4 + phase_rad_;
  const double bob_m = 0.02 * std::cos(2 * gait_rad) - 0.02;
  const Pose T_world_body{yaw_rotation(std::atan2(travel.y, travel.x)), at + Vec3{0, 0, bob_m}};
  add_trunk(T_world_body, gait_rad, shapes);
  for (double side : {-1.0, 1.0}) {
    add_leg(T_world_body, side, gait_rad + (side > 0 ? M_PI : 0), shapes);
    add_arm(T_world_body, side, gait_rad + (side > 0 ? M_PI : 0), shapes);
  }
}

}  // namespace stillmap::synthetic
