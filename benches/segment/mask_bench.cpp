// SPDX-License-Identifier: Apache-2.0
// The mask of a frame with two people beside the paper's rule, the boxes alone.
#include <benchmark/benchmark.h>

#include "segment/segment.h"
#include "tests/segment/scene.h"

namespace stillmap {
namespace {

void mask_by(benchmark::State& state, DynamicRule rule) {
  test::Scene room;
  room.wall(4000);
  room.floor(1200);
  room.body(100, 80, 260, 470, 2000);
  room.body(380, 120, 500, 460, 2700);
  Detections boxes;
  static_cast<void>(boxes.items.try_push_back(test::box_of(90, 70, 270, 475)));
  static_cast<void>(boxes.items.try_push_back(test::box_of(370, 110, 510, 465)));
  DynamicMask mask;
  for (auto _ : state) segment(boxes, room.depth.view(), room.camera, rule, mask);
}
void mask(benchmark::State& state) {
  mask_by(state, DynamicRule::Silhouette);
}
void mask_baseline_boxes(benchmark::State& state) {
  mask_by(state, DynamicRule::Paper);
}
BENCHMARK(mask)->Unit(benchmark::kMicrosecond);
BENCHMARK(mask_baseline_boxes)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace stillmap
