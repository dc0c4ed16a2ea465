// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "core/camera.h"
#include "core/config.h"
#include "core/detection.h"
#include "core/fixed_vector.h"
#include "core/geometry.h"
#include "core/image.h"

namespace stillmap {

/// Fills Detection::depth_m from the frame that the boxes were found in: the nearer quarter of the readings
/// in the middle of the box.
void measure_depths(Detections& detections, ImageView<const std::uint16_t> depth, const CameraModel& camera);

/// Brings boxes from the frame they were found in to the current one, so that a detector that is late, slow,
/// or misses now and then still gives boxes for every frame.
///
/// A box is held as a rectangle in space, at the depth of its object, with a velocity from the detections
/// before it; carrying projects it into the current camera. A detector that misses a sure object once or
/// twice does not end it, nor does one that says nothing for up to `detector.max_age_ms`. An object that the
/// detector is not sure of counts only when it is found again where it was: what scores it had, fading from
/// look to look, must sum up to `detector.confirm_score`. So a person half out of the picture, found weakly
/// but steadily, has a box, and a chair that was taken for one once has none. Used by the tracker's
/// thread; no heap.
class BoxCarrier {
 public:
  BoxCarrier(const CameraModel& camera, const Config::Detector& detector)
      : camera_(camera),
        max_age_ns_(static_cast<Nanoseconds>(detector.max_age_ms) * 1'000'000),
        confirm_score_(detector.confirm_score) {}

  /// Takes in a detector's word on one frame whose pose was `T_odom_camera`.
  void update(const Detections& fresh, const Pose& T_odom_camera);
  /// Forgets every box, for when the camera's place is lost: nothing can be carried then.
  void clear() { tracks_.clear(); }
  /// The boxes as they are on the frame at `stamp_ns`, seen from `T_odom_camera`. Boxes of that very frame
  /// come back as they were found; others grow a little with their age. Each has its object's number, age and
  /// velocity.
  void carry(Nanoseconds stamp_ns, const Pose& T_odom_camera, Detections& out);

 private:
  struct Track {
    Detection seen;               // as last found
    std::array<Vec3, 4> corners;  // odom frame, at seen_ns
    Vec3 centre, velocity;        // odom frame, m and m/s
    Nanoseconds first_seen_ns = 0, seen_ns = 0;
    std::uint32_t object = 0;
    bool has_velocity = false;
    bool matched = false;
    double evidence = 0;  // the scores of all looks, fading
    int misses = 0;       // how often the detector has looked since and not found it
  };
  Track track_of(const Detection& d, Nanoseconds stamp_ns, const Pose& T_odom_camera) const;
  Track* nearest(const Track& fresh);

  CameraModel camera_;
  Nanoseconds max_age_ns_;
  double confirm_score_;
  FixedVector<Track, 192> tracks_;  // three looks of all boxes that a detector gives
  std::uint32_t objects_ = 0;       // so far
};

}  // namespace stillmap
