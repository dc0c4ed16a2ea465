// SPDX-License-Identifier: Apache-2.0
// What a planner's questions cost: the map's own answer on its own thread beside those that any thread may
// ask.
#include <benchmark/benchmark.h>

#include <vector>

#include "core/random.h"
#include "map/map_queries.h"
#include "scene.h"

namespace stillmap {
namespace {

struct MappedRoom {
  MappedRoom() {
    synthetic::SyntheticLog log({.seed = 3, .people = 0});
    DynamicMask mask;
    mask.columns = 80;
    mask.rows = 60;
    for (int i = 0; i < 8; ++i) {
      test::Scene scene(log, 4 * i);
      const FrameSlot slot = scene.slot(static_cast<std::uint64_t>(i));
      camera = scene.truth.T_world_camera;
      static_cast<void>(map.fuse({.colour = slot.colour,
                                  .depth = slot.depth,
                                  .mask = mask,
                                  .T_map_camera_depth = camera,
                                  .T_map_camera_colour = camera,
                                  .sequence = static_cast<std::uint64_t>(i)}));
    }
  }
  Vec3 ahead(Random& random) const {
    const auto one = [&] { return random.uniform() - 0.5; };
    return camera * Vec3{3 * one(), 2 * one(), 2 + 2 * one()};
  }
  const Config config = test::synthetic_config();
  Arena arena{std::size_t{96} << 20};
  const RayTable rays{arena, config.camera};
  VoxelMap map{arena, config.map, config.camera, rays};
  MapQueries queries{map, true};
  Pose camera;
};
const MappedRoom& mapped() {
  static const MappedRoom room;
  return room;
}

void query_baseline_point_on_the_maps_thread(benchmark::State& state) {
  Random random(1);
  const MappedRoom& room = mapped();
  for (auto _ : state) benchmark::DoNotOptimize(room.map.at(room.ahead(random)));
}
void query_point(benchmark::State& state) {
  Random random(1);
  const MappedRoom& room = mapped();
  for (auto _ : state) benchmark::DoNotOptimize(room.queries.at(room.ahead(random)));
}
void query_ray_of_5_m(benchmark::State& state) {
  Random random(1);
  const MappedRoom& room = mapped();
  for (auto _ : state)
    benchmark::DoNotOptimize(room.queries.cast_ray(room.camera.t, room.ahead(random) - room.camera.t, 5));
}
void query_sweep_of_30_cm_over_3_m(benchmark::State& state) {
  Random random(1);
  const MappedRoom& room = mapped();
  for (auto _ : state)
    benchmark::DoNotOptimize(room.queries.sweep(room.camera.t, room.ahead(random) - room.camera.t, 0.3, 3));
}
void query_slice_of_4_by_4_by_1_m(benchmark::State& state) {
  const MappedRoom& room = mapped();
  std::vector<Occupancy> cells(100 * 100);
  const Vec3 t = room.camera.t;
  for (auto _ : state)
    benchmark::DoNotOptimize(room.queries.slice({t.x - 2, t.y - 2, t.z - 0.5, t.z + 0.5, 100, 100}, cells));
}

BENCHMARK(query_baseline_point_on_the_maps_thread);
BENCHMARK(query_point);
BENCHMARK(query_ray_of_5_m);
BENCHMARK(query_sweep_of_30_cm_over_3_m);
BENCHMARK(query_slice_of_4_by_4_by_1_m);

}  // namespace
}  // namespace stillmap
