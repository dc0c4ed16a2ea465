// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/feature.h"
#include "track/projection_matcher.h"

namespace stillmap {

/// How long after the first row's exposure the last one's comes: what the camera's profile says, or learned
/// where it says nothing. Two frames a moment apart that turn at different rates see the same points at
/// places which no rigid motion brings together unless rows are straightened (`rolling_shutter`) by the true
/// readout. Each such pair of frames is one linear measurement of it, once the motion between is eliminated
/// from the normal equations; a Kalman filter of one state takes them in. Used by one thread; no heap after
/// construction.
class ReadoutEstimator {
 public:
  /// `points`: one more than the largest slot of a FeatureMatch.
  ReadoutEstimator(Arena& arena, const CameraModel& camera, std::size_t points, std::size_t feature_capacity);

  double readout_s() const { return readout_s_; }
  /// Takes in a frame whose pose is known; does nothing where the profile knows the readout. `features` are
  /// straightened with `readout_s()`, `inliers[i]` is what feature i stands on (slot -1: on nothing),
  /// `turn_rad_per_s` how fast the camera turned, in its own frame.
  void observe(std::span<const Feature> features, std::span<const FeatureMatch> inliers, Nanoseconds stamp_ns,
               const Pose& T_odom_camera, Vec3 turn_rad_per_s);
  /// Forgets the frame that later ones are compared with: for when poses no longer connect.
  void clear() { sightings_.clear(); }

 private:
  struct Sighting {
    std::int32_t slot;
    Vec3 p_camera;     // straightened
    Vec3 moved_per_s;  // p_camera, by a longer readout
  };
  void compare(std::span<const Feature> features, std::span<const FeatureMatch> inliers,
               const Pose& T_past_now, Vec3 turn_rad_per_s);
  void remember(std::span<const Feature> features, std::span<const FeatureMatch> inliers,
                Vec3 turn_rad_per_s);
  Vec3 moved_per_s(const Feature& feature, Vec3 p_camera, Vec3 turn_rad_per_s) const;

  CameraModel camera_;
  std::span<std::int32_t> sighting_of_slot_;  // may be outdated: the sighting says its slot
  ArenaVector<Sighting> sightings_;           // of the frame that later ones are compared with
  Nanoseconds stamp_ns_ = 0;
  Pose T_odom_camera_;
  double sightings_readout_s_ = 0;  // that they were straightened with
  double readout_s_;
  double information_;  // 1/s^2, of readout_s_
};

}  // namespace stillmap
