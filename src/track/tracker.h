// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <span>

#include "core/arena.h"
#include "core/config.h"
#include "core/correction.h"
#include "core/dynamic_mask.h"
#include "core/frame_pool.h"
#include "core/status.h"
#include "core/tracking_result.h"
#include "track/depth_sampling.h"
#include "track/feature_extractor.h"
#include "track/feature_grid.h"
#include "track/frame_alignment.h"
#include "track/local_adjustment.h"
#include "track/local_map.h"
#include "track/localizer.h"
#include "track/loop_closing.h"
#include "track/map_builder.h"
#include "track/motion_check.h"
#include "track/motion_model.h"
#include "track/place_index.h"
#include "track/readout_estimator.h"
#include "track/semi_static_check.h"

namespace stillmap {

/// RGB-D frames in, camera poses out. A stage: it knows no threads; one thread calls it. No heap after
/// construction.
///
/// One frame: features; label them by the mask; predict the pose; match the local map around the prediction;
/// solve; match again, narrower, around the solution; solve; judge; refine the map's points; perhaps make a
/// keyframe.
///
/// Whoever calls `track` also sees to `adjustment().work()` and `loops().work()`, from one other thread or
/// between two frames: without them no keyframe is adjusted, no loop closed and no segment joined.
class Tracker {
 public:
  Tracker(Arena& arena, const Config& config);

  /// Where the camera will be at `stamp_ns`: by the robot's odometry where that reaches from the last posed
  /// frame to there, else if it goes on moving as it did.
  Pose predict(Nanoseconds stamp_ns);
  /// Tracks one frame. `mask` says what moves in it. The result stays valid until the next call.
  const TrackingResult& track(const FrameSlot& frame, const DynamicMask& mask);

  /// From the first row's exposure to the last one's, as the camera's profile has it or as learned so far.
  double readout_s() const { return readout_.readout_s(); }
  /// Of the keyframe that `track`'s newest result refers to.
  Pose T_odom_reference_keyframe() const { return T_odom_keyframe_; }
  /// Where all keyframes are now, of the newest result's epoch.
  void describe_keyframes(Correction& out) const;
  /// What a worker does for the local map beside tracking, where `waits()`; `track` takes its results.
  LocalAdjustment& adjustment() { return adjustment_; }
  LoopClosing& loops() { return loops_; }
  /// Where another thread may say how the robot moved.
  OdometrySource& odometry() { return motion_.odometry(); }
  const LocalMap& local_map() const { return map_; }
  /// Before the first frame: takes over what a KeyframeWriter wrote, and is Lost in it until a frame is
  /// recognised. The errors are `read_keyframes`'.
  Status resume(std::span<const std::byte> keyframes);

  /// Of `track.features`, how much is looked for from the next frame on: less, to save time.
  void set_feature_share(double share) { extractor_.set_share(share); }

  /// Where the camera sits on the robot (camera.T_base_camera); odom begins at the base. Identity when
  /// unknown.
  Pose T_base_camera() const { return T_base_camera_; }
  /// The newest frame's features with their final labels.
  std::span<const Feature> features() const { return frame_.features; }
  PoolUsage point_usage() const { return map_.point_usage(); }
  PoolUsage keyframe_usage() const { return map_.keyframe_usage(); }

 private:
  void start_map(const FrameSlot& slot);
  void start_segment(const FrameSlot& slot);
  void align(const FrameSlot& slot, const Pose& T_odom_camera_predicted);
  bool localize(const FrameSlot& slot, const Pose& T_odom_camera_predicted, const DynamicMask& mask);
  bool relocalize();
  void stand_on(const Keyframe& keyframe);
  bool found_by(Keyframe& keyframe);
  void label_features(const DynamicMask& mask, const Pose& T_depth_colour);
  void take_adjustment();
  void close_loops(std::uint64_t sequence);
  bool bridge(Nanoseconds stamp_ns, const DynamicMask& mask);
  void judge();
  bool wants_keyframe() const;
  void insert_keyframe(const FrameSlot& slot);
  void note_place(const Keyframe& keyframe);
  void count_labels();
  PosedFeatures posed(const FrameSlot& slot) {
    return {frame_, matches(), result_.T_odom_camera, slot.sequence, slot.colour_ns};
  }
  std::span<FeatureMatch> matches() { return localizer_.matches(); }

  Config config_;
  /// What is not left out (track.without).
  bool checks_motion_, aligns_, adjusts_, closes_loops_;
  Pose T_base_camera_;
  ImageView<std::uint8_t> grey_;  // of the frame at work
  FeatureExtractor extractor_;
  FrameAlignment alignment_;
  FrameFeatures frame_;
  FeatureGrid grid_;
  LocalMap map_;
  MapBuilder builder_;
  PlaceIndex places_;
  PlaceQuery like_this_;  // keyframes that a lost camera may be at
  Localizer localizer_;
  SemiStaticCheck semi_static_;
  MotionCheck motion_check_;
  LocalAdjustment adjustment_;
  LoopClosing loops_;
  ReadoutEstimator readout_;
  MotionModel motion_;

  TrackingResult result_;
  int inliers_before_ = 0;    // of the last frame found by points
  Nanoseconds found_ns_ = 0;  // its stamp
  Pose aligned_;              // T_odom_camera of this frame, by small pictures
  Pose T_odom_keyframe_;
  int keyframe_points_ = 0;
  std::uint32_t segment_begin_ = 0;  // first keyframe since the newest change of segment
  Nanoseconds keyframe_ns_ = 0;
  Nanoseconds lost_since_ns_ = 0;  // first frame of this loss in which there was enough to see; 0: none
};

}  // namespace stillmap
