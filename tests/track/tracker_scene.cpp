// SPDX-License-Identifier: Apache-2.0
#include "tracker_scene.h"

#include <algorithm>

namespace stillmap::test {

double drift_rmse_m(const std::vector<Tracked>& run) {
  double squared = 0;
  int count = 0;
  const Tracked* first = nullptr;
  for (const Tracked& t : run) {
    if (!t.result.has_pose()) continue;
    if (first == nullptr) first = &t;
    const Pose estimate = inverse(first->result.T_map_camera()) * t.result.T_map_camera();
    const Pose truth = inverse(first->T_world_camera) * t.T_world_camera;
    squared += dot(estimate.t - truth.t, estimate.t - truth.t);
    ++count;
  }
  return count == 0 ? 1e9 : std::sqrt(squared / count);
}

bool all_finite(const TrackingResult& r) {
  return is_finite(r.T_odom_camera) && is_finite(r.T_map_odom) && std::isfinite(r.rms_px) &&
         std::all_of(r.covariance.begin(), r.covariance.end(), [](double v) { return std::isfinite(v); });
}

Tracked TrackerScene::step(int index, const Change& change) {
  Scene scene(log, index);
  DynamicMask mask = scene.mask();
  if (change) change(index, scene, mask);
  const FrameSlot slot = scene.slot(static_cast<std::uint64_t>(index));
  const Tracked tracked{tracker.track(slot, mask), scene.truth.T_world_camera};
  tracker.adjustment().work();
  tracker.loops().work();
  EXPECT_TRUE(all_finite(tracked.result)) << "frame " << index;
  EXPECT_EQ(tracked.result.sequence, static_cast<std::uint64_t>(index));
  EXPECT_EQ(tracked.result.stamp_ns, scene.truth.stamp_ns);
  return tracked;
}

std::vector<Tracked> TrackerScene::run(int from, int to, const Change& change) {
  std::vector<Tracked> all;
  for (int i = from; i < to; ++i) all.push_back(step(i, change));
  return all;
}

}  // namespace stillmap::test
