// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/camera.h"
#include "core/feature.h"

namespace stillmap::test {

inline CameraModel kinect() {
  CameraModel camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 517;
  camera.cx = 318.6;
  camera.cy = 255.3;
  camera.k1 = 0.26;
  camera.k2 = -0.95;
  camera.k3 = 1.16;
  return camera;
}

/// What a camera that turns by `turn_rad` from its first row's exposure to its last one's sees of a point.
inline Feature exposed(const CameraModel& camera, Vec3 turn_rad, Vec3 p) {
  Vec3 seen = p;
  Vec2 pixel = camera.project(seen);
  for (int i = 0; i < 30; ++i) {  // the row says when, and when says the row
    seen = transposed(exp_so3((pixel.y / camera.height - 0.5) * turn_rad)) * p;
    pixel = camera.project(seen);
  }
  Feature f;
  f.x = static_cast<float>(pixel.x);
  f.y = static_cast<float>(pixel.y);
  f.ray_x = static_cast<float>(seen.x / seen.z);
  f.ray_y = static_cast<float>(seen.y / seen.z);
  f.depth_m = static_cast<float>(seen.z);
  return f;
}

}  // namespace stillmap::test
