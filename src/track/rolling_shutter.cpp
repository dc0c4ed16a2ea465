// SPDX-License-Identifier: Apache-2.0
#include "track/rolling_shutter.h"

#include <algorithm>

namespace stillmap {

void straighten_rows(const CameraModel& camera, Vec3 turn_rad, std::span<Feature> features) {
  for (Feature& f : features) {
    const Vec3 p = exp_so3((double{f.y} / camera.height - 0.5) * turn_rad) * Vec3{f.ray_x, f.ray_y, 1};
    const Vec2 pixel = camera.project(p);
    f.ray_x = static_cast<float>(p.x / p.z);
    f.ray_y = static_cast<float>(p.y / p.z);
    f.x = std::clamp(static_cast<float>(pixel.x), 0.0F, static_cast<float>(camera.width - 1));
    f.y = std::clamp(static_cast<float>(pixel.y), 0.0F, static_cast<float>(camera.height - 1));
  }
}

}  // namespace stillmap
