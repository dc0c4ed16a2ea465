// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "map/voxel_map.h"

namespace stillmap::test {

/// A small camera with the lens of TUM freiburg1 (a quarter of its pixels), or without distortion.
inline CameraModel small_camera(bool distorted = false) {
  CameraModel c;
  c.width = 160;
  c.height = 120;
  c.fx = 517.3 / 4;
  c.fy = 516.5 / 4;
  c.cx = 318.6 / 4;
  c.cy = 255.3 / 4;
  c.depth_units_per_m = 5000;
  if (distorted) {
    c.k1 = 0.2624;
    c.k2 = -0.9531;
    c.p1 = -0.0054;
    c.p2 = 0.0026;
    c.k3 = 1.1633;
  }
  return c;
}

/// What a ray from `origin` along `direction` meets: the distance in units of `direction`, and its colour.
struct Hit {
  double t = 0;
  Bgr colour;
};
using Scene = std::function<std::optional<Hit>(Vec3 origin, Vec3 direction)>;

/// The plane dot(n, p) = d.
inline std::optional<Hit> meet_plane(Vec3 origin, Vec3 direction, Vec3 n, double d, Bgr colour) {
  const double t = (d - dot(n, origin)) / dot(n, direction);
  return t > 0 && std::isfinite(t) ? std::optional<Hit>({t, colour}) : std::nullopt;
}

/// Pictures with their own memory.
struct Picture {
  std::vector<Bgr> colour;
  std::vector<std::uint16_t> depth;
  DynamicMask mask;
};

/// A map with its arena, ray table and a way to show it scenes.
class MapUnderTest {
 public:
  explicit MapUnderTest(const CameraModel& camera, Config::Map config = {}, EvictedBlocks* evicted = nullptr)
      : camera_(camera),
        arena_(planned_bytes(camera, config)),
        rays_(arena_, camera),
        map_(arena_, config, camera, rays_, evicted) {}

  static std::size_t planned_bytes(const CameraModel& camera, const Config::Map& config) {
    Arena plan;
    const RayTable rays(plan, camera);
    const VoxelMap map(plan, config, camera, rays);
    return plan.bytes_planned();
  }

  Picture render(const Scene& scene, const Pose& T_map_camera) const {
    Picture p;
    const std::size_t pixels =
        static_cast<std::size_t>(camera_.width) * static_cast<std::size_t>(camera_.height);
    p.colour.resize(pixels);
    p.depth.resize(pixels);
    for (int y = 0; y < camera_.height; ++y) {
      for (int x = 0; x < camera_.width; ++x) {
        const RayTable::Ray ray = rays_.at(x, y);
        const auto hit = scene(T_map_camera.t, T_map_camera.R * Vec3{ray.x, ray.y, 1});
        if (!hit) continue;
        const std::size_t i = static_cast<std::size_t>(y * camera_.width + x);
        const double raw = std::round(hit->t * camera_.depth_units_per_m);
        p.depth[i] = raw < 65535 ? static_cast<std::uint16_t>(raw) : 0;
        p.colour[i] = hit->colour;
      }
    }
    return p;
  }
  FuseInput input(Picture& p, const Pose& T_map_camera, std::uint64_t sequence = 1,
                  std::uint32_t anchor = 0) const {
    const int w = camera_.width, h = camera_.height;
    return {.colour = {p.colour.data(), w, h, w},
            .depth = {p.depth.data(), w, h, w},
            .mask = p.mask,
            .T_map_camera_depth = T_map_camera,
            .T_map_camera_colour = T_map_camera,
            .anchor_keyframe = anchor,
            .T_map_keyframe = T_map_camera,
            .sequence = sequence};
  }
  /// Renders and fuses `times` frames of the scene.
  void see(const Scene& scene, const Pose& T_map_camera = {}, int times = 1, std::uint32_t anchor = 0) {
    Picture p = render(scene, T_map_camera);
    for (int i = 0; i < times; ++i) {
      ++sequence_;
      if (map_.fuse(input(p, T_map_camera, sequence_, anchor)) != FuseOutcome::Fused) std::abort();
    }
  }

  VoxelMap& map() { return map_; }
  const CameraModel& camera() const { return camera_; }
  const RayTable& rays() const { return rays_; }
  Arena& arena() { return arena_; }

 private:
  CameraModel camera_;
  Arena arena_;
  RayTable rays_;
  VoxelMap map_;
  std::uint64_t sequence_ = 0;
};

/// A wall at z = `depth_m` before a camera at the origin.
inline Scene wall(double depth_m, Bgr colour = {40, 80, 120}) {
  return [=](Vec3 o, Vec3 d) { return meet_plane(o, d, {0, 0, 1}, depth_m, colour); };
}

/// The inside of a box room of 6 x 4 x 6 m around the origin, each wall with its colour.
inline Scene room() {
  return [](Vec3 o, Vec3 d) {
    std::optional<Hit> nearest;
    const auto meet = [&](Vec3 n, double at, Bgr colour) {
      const auto hit = meet_plane(o, d, n, at, colour);
      if (hit && (!nearest || hit->t < nearest->t)) nearest = hit;
    };
    meet({1, 0, 0}, 3, {0, 0, 200});
    meet({1, 0, 0}, -3, {0, 200, 0});
    meet({0, 1, 0}, 2, {200, 0, 0});
    meet({0, 1, 0}, -2, {0, 200, 200});
    meet({0, 0, 1}, 3, {200, 200, 0});
    meet({0, 0, 1}, -3, {200, 0, 200});
    return nearest;
  };
}

/// Every occupied voxel's place and colour, to compare maps.
inline std::string bytes_of(const VoxelMap& map) {
  std::string bytes;
  map.for_each_occupied([&](const OccupiedVoxel& v) {
    bytes.append(reinterpret_cast<const char*>(&v.x), sizeof(float));
    bytes.append(reinterpret_cast<const char*>(&v.y), sizeof(float));
    bytes.append(reinterpret_cast<const char*>(&v.z), sizeof(float));
    bytes.append(reinterpret_cast<const char*>(&v.colour), 3);
  });
  return bytes;
}

/// A camera turned about its upright axis.
inline Pose turned(double yaw, Vec3 t = {}) {
  return {exp_so3({0, yaw, 0}), t};
}

}  // namespace stillmap::test
