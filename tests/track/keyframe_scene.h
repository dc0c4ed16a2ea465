// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "scene.h"
#include "track/local_map.h"

namespace stillmap::test {

/// A made-up corner of the world, and how it looks.
struct SceneCorner {
  Vec3 p_world;
  Descriptor descriptor;
};

/// `count` corners somewhere in front of a camera at T_world_camera, 1 to 4 m away.
inline std::vector<SceneCorner> corners_before(const Pose& T_world_camera, int count, Random& random) {
  std::vector<SceneCorner> corners;
  for (int i = 0; i < count; ++i) {
    const double z = 1 + 3 * random.uniform();
    const Vec3 p{(random.uniform() - 0.5) * 1.1 * z, (random.uniform() - 0.5) * 0.85 * z, z};
    corners.push_back({T_world_camera * p, random_descriptor(random)});
  }
  return corners;
}

/// What a camera at T_world_camera sees of the corners: those in its picture, exactly.
inline void see(const CameraModel& camera, const Pose& T_world_camera,
                const std::vector<SceneCorner>& corners, Keyframe& out) {
  out.alive = true;
  out.T_odom_camera = T_world_camera;
  out.features.clear();
  for (const SceneCorner& c : corners) {
    const Vec3 p = inverse(T_world_camera) * c.p_world;
    if (p.z < 0.3) continue;
    const Feature f = feature_of(camera, p);
    if (f.x < 0 || f.y < 0 || f.x >= static_cast<float>(camera.width) ||
        f.y >= static_cast<float>(camera.height))
      continue;
    out.descriptors[out.features.size()] = c.descriptor;
    if (!out.features.try_push_back({f.ray_x, f.ray_y, f.depth_m, 0, {}})) return;
  }
}

}  // namespace stillmap::test
