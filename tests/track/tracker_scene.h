// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <vector>

#include "scene.h"
#include "track/tracker.h"

namespace stillmap::test {

/// One frame's result beside its truth.
struct Tracked {
  TrackingResult result;
  Pose T_world_camera;
};

/// Root mean square distance of poses from the truth, both as seen from the first pose: no alignment flatters
/// it.
double drift_rmse_m(const std::vector<Tracked>& run);
/// Every number of a result that may be published.
bool all_finite(const TrackingResult& result);

/// A tracker over a rendered log.
class TrackerScene {
 public:
  explicit TrackerScene(const synthetic::SyntheticOptions& options, Config config = synthetic_config())
      : log(options), tracker(arena, config) {}

  /// What is done to a frame before it is tracked.
  using Change = std::function<void(int index, Scene& scene, DynamicMask& mask)>;
  Tracked step(int index, const Change& change = {});
  std::vector<Tracked> run(int from, int to, const Change& change = {});

  synthetic::SyntheticLog log;
  Arena arena{std::size_t{160} << 20};
  Tracker tracker;
};

}  // namespace stillmap::test
