// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "track/feature_extractor.h"
#include "track/local_map.h"
#include "track/window_adjuster.h"

namespace stillmap {

/// Copies the part of the local map around its newest keyframe out for adjustment, and takes the result
/// back. The tracker's thread; no heap.
class WindowSelector {
 public:
  WindowSelector(Arena& arena, const CameraModel& camera, std::size_t points);

  /// The newest keyframe and the newest of those that share points with it are free, the others that share
  /// most are fixed. Points that may move stay out. False where too little is shared to adjust anything.
  bool select(LocalMap& map, const FeatureExtractor& extractor, AdjustmentWindow& window);
  /// Moves what is still there of the window's keyframes and points. Returns the newest keyframe's move:
  /// T_odom_camera after = move * before.
  static Pose apply(const AdjustmentWindow& window, LocalMap& map);

 private:
  void choose_views(LocalMap& map, const Keyframe& newest, AdjustmentWindow& window);

  CameraModel camera_;
  std::span<std::uint16_t> index_of_slot_;  // of a map point: its index in the window, or one of the marks
};

}  // namespace stillmap
