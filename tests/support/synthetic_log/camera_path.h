// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "core/geometry.h"

namespace stillmap::synthetic {

enum class PathKind : std::uint8_t {
  Orbit,  ///< around the table, looking at it
  Walk,   ///< around the table, looking ahead along the way
  Rotate  ///< in one place, turning about all three axes
};

/// A smooth, handheld-like motion, defined for every time. A pure function of seed and time.
class CameraPath {
 public:
  /// Ways around the table are longer along x, as the room is.
  static constexpr double kStretch = 1.1;

  CameraPath(std::uint64_t seed, PathKind kind);
  Pose T_world_camera(double t_s) const;
  /// The camera's direction as seen from the table, and the sense in which that turns (+1 or -1).
  double azimuth_rad(double t_s) const;
  double direction() const { return direction_; }

 private:
  Vec3 position(double t_s) const;
  Vec3 target(double t_s) const;
  /// A sum of three slow waves and `tremor` of two fast ones, in about [-1, 1].
  double sway(int channel, double t_s, double tremor) const;

  PathKind kind_;
  double start_rad_ = 0, direction_ = 1;
  static constexpr int kChannels = 12, kWaves = 5;
  std::array<std::array<double, kWaves>, kChannels> phase_rad_{}, rate_rad_s_{};
};

}  // namespace stillmap::synthetic
