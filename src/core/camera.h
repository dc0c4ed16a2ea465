// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <span>

#include "core/arena.h"
#include "core/geometry.h"

namespace stillmap {

/// A pinhole camera with the Brown-Conrady lens distortion that OpenCV and ROS call plumb_bob. Camera axes:
/// x right, y down, z forward. Pixel centres are at whole numbers.
struct CameraModel {
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;
  double depth_units_per_m = 1000;
  double depth_min_m = 0.3, depth_max_m = 8;
  /// Axial depth noise (1 sigma) is depth_noise_m_at_1m * z^2 with z in metres, as structured light and
  /// stereo have it (Khoshelham and Elberink, Sensors 12(2), 2012, eq. 10).
  double depth_noise_m_at_1m = 0.0025;
  /// From the first row's exposure to the last one's; 0: a global shutter, negative: from the bottom up;
  /// none: unknown.
  std::optional<double> readout_s{};
  /// How far (1 sigma) a pixel's exposure may be from the colour stamp: rolling shutter, and the clock.
  double stamp_sigma_s = 0.02;

  /// Point in the camera frame (z > 0) to the pixel where the lens shows it.
  Vec2 project(Vec3 p_camera) const;
  /// Pixel to the normalised, undistorted image plane: the ray (x, y, 1).
  Vec2 undistort(Vec2 pixel) const;
  /// Depth in metres of a raw reading; 0 where there is none or it is out of the trusted range.
  double depth_m(std::uint16_t raw) const {
    const double z = raw / depth_units_per_m;
    return z >= depth_min_m && z <= depth_max_m ? z : 0;
  }
  double depth_sigma_m(double z_m) const { return depth_noise_m_at_1m * z_m * z_m; }
  /// A pixel (of a coarse grid and the picture's rim) at which the lens model folds the picture over itself,
  /// so that no single ray belongs to it; nothing for a sound lens.
  std::optional<Vec2> folded_pixel() const;
};

/// The undistorted ray (x, y, 1) of every pixel, so that back-projecting a picture honours the lens at the
/// price of a multiplication. Read-only after construction; any thread.
class RayTable {
 public:
  struct Ray {
    float x = 0, y = 0;
  };
  RayTable(Arena& arena, const CameraModel& camera);
  Ray at(int x, int y) const {
    return rays_[static_cast<std::size_t>(y) * width_ + static_cast<std::size_t>(x)];
  }

 private:
  std::span<Ray> rays_;
  std::size_t width_ = 0;
};

}  // namespace stillmap
