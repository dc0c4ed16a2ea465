// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "core/arena.h"
#include "core/feature.h"
#include "core/time.h"
#include "track/symmetric.h"

namespace stillmap {

/// A corner of the world. Positions are in the odom frame.
struct MapPoint {
  Vec3 p_odom;
  /// Inverse covariance of p_odom, upper triangle: xx, xy, xz, yy, yz, zz, in 1/m^2.
  Symmetric3 information{};
  Vec3 view_direction;  ///< unit vector from the point to the camera that last described it
  Descriptor descriptor;
  double reference_distance_m = 0;  ///< from that camera
  std::uint8_t reference_octave = 0;
  bool alive = false;
  bool suspect = false;  ///< found on something that may move; must prove that it stands still
  std::uint16_t visible = 0, found = 0;  ///< frames that should have seen it, frames that did
  std::uint32_t id = 0;  ///< not used twice in 2^32 points, and never 0, so that a stale index is noticed
  std::uint32_t segment = 0;  ///< to which it belongs
  Nanoseconds made_ns = 0;    ///< stamp of the frame that it was made from
  std::uint64_t last_found_sequence = 0;
};

/// Points to a MapPoint; stale when the slot has been given to another point since.
struct PointRef {
  std::int32_t slot = -1;
  std::uint32_t id = 0;
};

/// A feature as a keyframe keeps it.
struct KeyframeFeature {
  float ray_x = 0, ray_y = 0, depth_m = 0;
  std::uint8_t octave = 0;
  PointRef point;
};

struct Keyframe {
  bool alive = false;
  std::uint32_t id = 0;
  std::uint32_t segment = 0;  ///< to which it belongs
  std::uint64_t sequence = 0;
  Nanoseconds stamp_ns = 0;
  Pose T_odom_camera;
  int tracked_points = 0;  ///< how many points it saw when it was made, new ones included
  FixedVector<KeyframeFeature, kMaxFeatures> features;
  std::array<Descriptor, kMaxFeatures> descriptors;
};

/// Keyframes and points in memory fixed at start. The tracker's thread owns it.
class LocalMap {
 public:
  LocalMap(Arena& arena, std::size_t keyframes, std::size_t points);

  /// A slot for a new point with a fresh id; when full, those that were found longest ago go (counted).
  PointRef add_point(const MapPoint& point);
  void remove_point(std::size_t slot);
  std::span<MapPoint> points() { return points_; }
  std::span<const MapPoint> points() const { return points_; }
  /// The point, or nullptr where the reference is stale.
  MapPoint* find(PointRef ref);

  /// A slot for a new keyframe with a fresh id; when full, the one that the others make most redundant goes.
  Keyframe& add_keyframe();
  /// Later ids are of keyframes made from now on.
  void begin_keyframe_ids_after(std::uint32_t id) { next_keyframe_id_ = id + 1; }
  std::uint32_t next_keyframe_id() const { return next_keyframe_id_; }
  std::span<Keyframe> keyframes() { return keyframes_; }
  std::span<const Keyframe> keyframes() const { return keyframes_; }
  Keyframe* newest_keyframe();
  /// The keyframe with this id, or nullptr when it is gone.
  const Keyframe* find_keyframe(std::uint32_t id) const;

  /// What is added from now on is a segment of its own: tracking was lost, and nothing is known of how it
  /// stands to what was there before. Segments count from 1.
  void begin_segment() { segment_ = ++last_segment_; }
  /// The camera has been found in this one: what is added from now on belongs to it.
  void enter_segment(std::uint32_t segment) {
    segment_ = segment;
    last_segment_ = std::max(last_segment_, segment);
  }
  /// How `other` stands to `segment` is known now: they are one.
  void join_segments(std::uint32_t segment, std::uint32_t other);
  std::uint32_t segment() const { return segment_; }
  bool in_segment(const MapPoint& point) const { return point.segment == segment_; }

  void clear();
  PoolUsage point_usage() const { return {"points", points_.size(), points_high_water_, points_refused_}; }
  PoolUsage keyframe_usage() const {
    return {"keyframes", keyframes_.size(), keyframes_high_water_, keyframes_evicted_};
  }

 private:
  void give_up_points();
  std::size_t keyframe_to_reuse() const;

  std::span<MapPoint> points_;
  std::span<std::uint32_t> free_points_;
  std::span<std::uint32_t> by_age_;  // slots, while some are given up
  std::size_t free_count_ = 0;
  std::span<Keyframe> keyframes_;
  // A busy tracker makes 2^32 points in some months. Ids begin shortly before they wrap, so that every run
  // does what a run of months will.
  std::uint32_t next_point_id_ = ~std::uint32_t{0} - 5000;
  std::uint32_t next_keyframe_id_ = 1;  // at three a second they last for 45 years
  std::uint32_t segment_ = 0, last_segment_ = 0;
  std::uint64_t points_high_water_ = 0, points_refused_ = 0, keyframes_high_water_ = 0,
                keyframes_evicted_ = 0;
};

}  // namespace stillmap
