// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "core/fixed_vector.h"
#include "core/geometry.h"
#include "core/spsc_ring.h"
#include "core/time.h"

namespace stillmap {

/// How far the robot says it moved, by its wheels or an inertial unit.
struct MotionDelta {
  Nanoseconds from_ns = 0, to_ns = 0;  ///< on the clock of the frames' stamps, to_ns later
  /// From the base at to_ns to the base at from_ns, m (the base is camera.T_base_camera's; the camera itself
  /// where that is not set).
  Pose T_from_to;
  /// Its covariance: 1 sigma per axis, the same along each.
  double sigma_rotation_rad = 0, sigma_translation_m = 0;
};

/// What the robot's odometry says, for the tracker to go by where it sees too little. Optional: nothing is
/// asked of it until it has said something. One thread pushes, the tracker's thread asks; no locks, no heap.
class OdometrySource {
 public:
  /// The producer's thread. A delta begins where the last one ended; another one breaks the chain, and
  /// nothing is known across the break. False, and the delta is not taken, where it is no motion forward in
  /// time, a number is not finite, a sigma is not positive, or 64 deltas wait already.
  [[nodiscard]] bool try_push(const MotionDelta& delta);

  /// The tracker's thread. The motion from `from_ns` to `to_ns` (which may be earlier), `T_from_to` as in
  /// MotionDelta, interpolated within a delta; nothing where the chain does not reach. Up to 50 ms beyond its
  /// end it is taken to go on as it did last.
  std::optional<MotionDelta> between(Nanoseconds from_ns, Nanoseconds to_ns);

 private:
  /// Dead reckoning from the chain's begin.
  struct Sample {
    Nanoseconds stamp_ns = 0;
    Pose T_begin_base;
    double variance_rotation = 0, variance_translation = 0;
  };
  void take_waiting();
  std::optional<Sample> at(Nanoseconds stamp_ns) const;

  SpscRing<MotionDelta, 64> waiting_;
  FixedVector<Sample, 256> chain_;  // oldest first
};

}  // namespace stillmap
