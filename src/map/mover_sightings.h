// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/detection.h"
#include "core/geometry.h"
#include "core/time.h"

namespace stillmap {

/// Which of a detector's boxes keep something out of the map. A detector now and then takes coats on a wall
/// or a floor for a person, weakly, for some frames; what the map leaves out then it may never see again. So
/// a weak box counts only where a mover was surely found lately, or where boxes have been found for a while:
/// a person whom the detector is never sure of is mapped for kRipe_s at most, and cleared as soon as they
/// move. One thread; no heap.
class MoverSightings {
 public:
  static constexpr double kSure =
      1.25;  // times the score with which the tracker believes in an object at once
  static constexpr double kReach_m = 0.8, kRipe_s = 0.4, kKept_s = 1;

  /// `confirm_score` is `detector.confirm_score`: what a network's scores are worth is the network's own.
  MoverSightings(Arena& arena, const CameraModel& camera, double confirm_score)
      : camera_(camera),
        sure_score_(static_cast<float>(kSure * confirm_score)),
        sightings_(arena.take<Sighting>("map_mover_sightings", 1024)) {}

  /// Takes in what was found on the frame at `boxes.stamp_ns`, depths measured, and removes the moving boxes
  /// that do not count. Boxes without depth, which have no place, do. True where any was removed.
  bool filter(Detections& boxes, const Pose& T_map_camera);
  /// From which on a box is sure.
  float sure_score() const { return sure_score_; }

 private:
  struct Sighting {
    Nanoseconds stamp_ns = 0;
    Vec3 p_map;
    bool sure = false;
  };
  void note(const Detections& boxes, const Pose& T_map_camera);
  bool counts(const Detection& box, Nanoseconds stamp_ns, const Pose& T_map_camera) const;
  Vec3 place_of(const Detection& box, const Pose& T_map_camera) const;

  CameraModel camera_;
  float sure_score_;
  std::span<Sighting> sightings_;  // the newest, in a ring
  std::uint64_t noted_ = 0;
};

}  // namespace stillmap
