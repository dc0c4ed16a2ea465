// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "core/dynamic_mask.h"
#include "core/frame_pool.h"
#include "core/tracking_result.h"
#include "detect/box_carrier.h"
#include "track/keyframe_copier.h"
#include "track/tracker.h"

namespace stillmap {

/// A tracked frame on its way to the map.
struct PosedFrame {
  std::uint64_t sequence = 0;
  Nanoseconds stamp_ns = 0;  ///< of its colour
  FrameHandle frame;         ///< empty where the map shall wait for the detector's word on it
  Pose T_map_colour;         ///< T_map_camera at the colour stamp
  Pose T_map_depth;          ///< T_map_camera at the depth stamp
  std::uint32_t reference_keyframe = 0;
  Pose T_map_keyframe;             ///< the reference keyframe's own
  std::uint32_t epoch = 0;         ///< correction epoch that all these poses are of
  bool boxes_are_its_own = false;  ///< the mask was made from detections of this very frame
  DynamicMask mask;
};

/// What became of the detector's boxes, counted per frame.
struct BoxSupply {
  std::uint64_t fresh = 0, carried = 0, none = 0;
};

/// Frames and boxes in, poses out: carries the boxes to the frame, makes the mask, tracks. Knows no threads.
class TrackStage {
 public:
  TrackStage(Arena& arena, const Config& config);

  /// The detector's word on an earlier frame, or on the one that comes next.
  void take_boxes(const Detections& boxes);
  const TrackingResult& step(const FrameSlot& frame);
  /// The frame just stepped, for the map; only when it has a pose.
  void fill_posed(const FrameHandle& frame, PosedFrame& out) const;

  /// What a worker does beside the track thread; the adjustment first.
  LocalAdjustment& adjustment() { return tracker_.adjustment(); }
  LoopClosing& loops() { return tracker_.loops(); }
  /// Any thread: one of them has work.
  bool work_waits() { return adjustment().waits() || loops().waits(); }
  /// Before the first frame: see Tracker.
  Status resume(std::span<const std::byte> keyframes) { return tracker_.resume(keyframes); }
  /// Copies a bounded number of keyframes for a checkpoint that waits for them.
  void serve_checkpoint() { copier_.serve(tracker_.local_map(), result_.T_map_odom); }
  KeyframeCopier& copier() { return copier_; }

  void set_feature_share(double share) { tracker_.set_feature_share(share); }

  /// The camera in the robot's base, where the configuration knows it.
  Pose T_base_camera() const { return tracker_.T_base_camera(); }
  const Tracker& tracker() const { return tracker_; }
  Pose T_map_odom() const { return result_.T_map_odom; }
  /// Of the frame just stepped.
  const DynamicMask& mask() const { return mask_; }
  const BoxSupply& box_supply() const { return box_supply_; }

 private:
  const Pose* pose_of(std::uint64_t sequence) const;

  Config config_;
  bool carries_boxes_;  // or else only a frame's own are used (track.without)
  Tracker tracker_;
  KeyframeCopier copier_;
  BoxCarrier carrier_;
  DynamicMask mask_;
  Detections carried_;
  Detections pending_;  // of the frame that comes next
  bool has_pending_ = false;
  bool boxes_are_its_own_ = false;
  BoxSupply box_supply_;
  TrackingResult result_;
  Pose T_map_depth_;
  struct SequencePose {
    std::uint64_t sequence = ~std::uint64_t{0};
    Pose T_odom_camera;
  };
  std::array<SequencePose, 64> recent_{};  // by sequence modulo size: what late boxes are looked up in
};

}  // namespace stillmap
