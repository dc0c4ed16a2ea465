// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "core/time.h"

namespace stillmap {

/// One step of the plan by which quality is given up for time.
struct Quality {
  const char* name;
  int detector_every;    ///< the detector is offered every n-th frame only
  double feature_share;  ///< of track.features
  int fuse_factor;       ///< times map.fuse_every
};

/// In this order: boxes are carried anyway, features are many, and the map has time; the pose comes last.
constexpr std::array<Quality, 7> kSheddingPlan{{{"full quality", 1, 1, 1},
                                                {"detector on every 3rd frame", 3, 1, 1},
                                                {"detector on every 6th frame", 6, 1, 1},
                                                {"three quarters of the features", 6, 0.75, 1},
                                                {"half the features", 6, 0.5, 1},
                                                {"half the fusion", 6, 0.5, 2},
                                                {"a quarter of the fusion", 6, 0.5, 4}}};

/// Decides when to take a step of the plan down or up again: down soon, up late, and later each time that it
/// proved too early. It knows no clock; one thread.
class LoadShedder {
 public:
  explicit LoadShedder(Nanoseconds frame_period) : period_(frame_period) {}

  enum class Change { None, Lowered, Raised };
  /// Once a frame: how long after it was due it had its pose, and whether frames were lost for want of time.
  Change note(Nanoseconds latency, bool lost_frames);
  int step() const { return step_; }

 private:
  // The first second's caches are cold. Then half a second with a quarter of its frames too late is enough;
  // one late frame is a hiccup.
  static constexpr int kWarmUp = 30, kWindow = 15, kLateToLower = 4;
  static constexpr int kCalmToRaise = 90, kMostPatience = 8, kCalmCostOfLate = 10;
  static constexpr double kCalmShare = 0.8;  // of the period: room for what a step up brings back

  Nanoseconds period_;
  int step_ = 0;
  int warm_up_ = kWarmUp;
  int seen_ = 0, late_ = 0;  // in this window
  int calm_ = 0;             // frames with time to spare, less those that one late frame outweighs
  int patience_ = 1;
  int since_raise_ = 0;
  Change last_ = Change::None;
};

}  // namespace stillmap
