// SPDX-License-Identifier: Apache-2.0
// One frame into the map beside a hash of voxels that every depth reading is added to, which clears nothing.
#include <benchmark/benchmark.h>

#include <unordered_map>

#include "map/voxel_map.h"
#include "scene.h"

namespace stillmap {
namespace {

struct Frames {
  Frames() {
    synthetic::SyntheticLog log({.seed = 3, .people = 0});
    for (int i = 0; i < 8; ++i) all.emplace_back(log, 4 * i);
  }
  std::vector<test::Scene> all;
};
Frames& frames() {
  static Frames eight;
  return eight;
}

void fusion(benchmark::State& state) {
  const Config config = test::synthetic_config();
  Arena arena(std::size_t{96} << 20);
  const RayTable rays(arena, config.camera);
  VoxelMap map(arena, config.map, config.camera, rays);
  DynamicMask mask;
  mask.columns = 80;
  mask.rows = 60;
  std::uint64_t next = 0;
  const auto fuse_next = [&] {
    test::Scene& scene = frames().all[next % frames().all.size()];
    const FrameSlot slot = scene.slot(next++);
    const Pose& T = scene.truth.T_world_camera;
    return map.fuse({.colour = slot.colour,
                     .depth = slot.depth,
                     .mask = mask,
                     .T_map_camera_depth = T,
                     .T_map_camera_colour = T,
                     .sequence = next});
  };
  for (std::size_t i = 0; i < 2 * frames().all.size(); ++i) {
    if (fuse_next() != FuseOutcome::Fused) return state.SkipWithError("the map refused a frame");
  }
  for (auto _ : state) benchmark::DoNotOptimize(fuse_next());
  state.counters["voxels"] = static_cast<double>(map.occupied_voxels());
}
void fusion_baseline_hash_of_points(benchmark::State& state) {
  const Config config = test::synthetic_config();
  struct Voxel {
    int seen = 0;
    Bgr colour;
  };
  std::unordered_map<std::uint64_t, Voxel> voxels;
  std::uint64_t next = 0;
  const std::size_t count = frames().all.size();
  for (auto _ : state) {
    test::Scene& scene = frames().all[next % count];
    const FrameSlot slot = scene.slot(next++);
    for (int y = 0; y < slot.depth.height; ++y) {
      for (int x = 0; x < slot.depth.width; ++x) {
        const double z = config.camera.depth_m(slot.depth.at(x, y));
        if (z <= 0 || z > config.map.max_range_m) continue;
        const Vec2 ray = config.camera.undistort({static_cast<double>(x), static_cast<double>(y)});
        const Vec3 p = scene.truth.T_world_camera * Vec3{ray.x * z, ray.y * z, z};
        const auto cell = [&](double v) {
          return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(v / config.map.voxel_m))) &
                 0x1fffff;
        };
        Voxel& voxel = voxels[cell(p.x) << 42 | cell(p.y) << 21 | cell(p.z)];
        ++voxel.seen;
        voxel.colour = slot.colour.at(x, y);
      }
    }
  }
  state.counters["voxels"] = static_cast<double>(voxels.size());
}
BENCHMARK(fusion)->Unit(benchmark::kMicrosecond);
BENCHMARK(fusion_baseline_hash_of_points)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace stillmap
