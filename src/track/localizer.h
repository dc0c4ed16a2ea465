// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "core/arena.h"
#include "core/config.h"
#include "core/fixed_vector.h"
#include "core/random.h"
#include "track/feature_extractor.h"
#include "track/feature_grid.h"
#include "track/local_map.h"
#include "track/pose_solver.h"
#include "track/projection_matcher.h"
#include "track/relocalizer.h"

namespace stillmap {

/// Where the camera may be in a frame that follows another one.
struct PoseGuess {
  Pose T_odom_camera;           ///< by the motion model
  std::optional<Pose> aligned;  ///< T_odom_camera by the picture as a whole
  bool long_step = false;       ///< so much time since the last frame that neither says much
  int inliers_before = 0;       ///< of the last frame that was found
};

/// Finds the camera in the local map: matches the features of a frame to the map's points around a guess, and
/// solves for the pose. `begin` each frame; then `follow`, or `around` what a keyframe found; then `refine`.
/// Stands on what it is given at construction, which must stay where it is. The tracker's thread; no heap
/// after construction.
class Localizer {
 public:
  Localizer(Arena& arena, const Config& config, LocalMap& map, const FrameFeatures& frame,
            const FeatureGrid& grid, const FeatureExtractor& extractor);
  Localizer(const Localizer&) = delete;

  /// A new frame. What `prior` says of the pose counts where its features tell too little. `movers_known`: a
  /// network has said what moves in it, so that of what is left, most is the still world; else most may be
  /// people.
  void begin(std::uint64_t sequence, Nanoseconds stamp_ns, const std::optional<PosePrior>& prior,
             bool movers_known);
  /// From the frame before: around the guess, and where that finds little, around the aligned one and, after
  /// a long step, where the newest keyframe puts the camera. The best of them counts.
  bool follow(const PoseGuess& guess);
  /// Where one keyframe says that the camera is: to be confirmed by `around`.
  std::optional<FoundPose> find_by(const Keyframe& keyframe);
  /// By the map's points, near this pose.
  bool around(const Pose& T_odom_camera);
  /// Once more around what was found, where only noise is left.
  bool refine();

  /// Of the newest of these calls that returned true.
  const Pose& T_odom_camera() const { return T_odom_camera_; }
  /// Of the newest call, as all that follow.
  const PoseEstimate& estimate() const { return estimate_; }
  int matched() const { return matched_; }  ///< features, inliers or not
  /// Of the map, in this frame: what its time is made of.
  int searches() const { return searches_; }
  /// For each feature the point that it is an inlier of.
  std::span<FeatureMatch> matches() { return matches_.first(frame_.features.size()); }
  /// The points that were looked for and that nothing hides should have been seen.
  void count_visible(ImageView<const std::uint16_t> depth) { matcher_.count_visible(map_, depth); }

 private:
  bool search(const PoseGuess& guess);
  void keep_best();
  bool match_and_solve(const SearchWindow& window, const Pose& T_odom_camera);

  const Config config_;
  const bool weighs_trust_, samples_;
  LocalMap& map_;
  const FrameFeatures& frame_;
  const FeatureGrid& grid_;
  const FeatureExtractor& extractor_;
  ProjectionMatcher matcher_;
  Relocalizer relocalizer_;
  std::span<FeatureMatch> matches_;
  struct {
    PoseEstimate estimate;
    int matched = 0;
    std::span<FeatureMatch> matches;
  } best_;  // of this frame's searches
  ArenaVector<PoseObservation> observations_;
  std::span<std::uint16_t> observed_feature_;  // which feature observation i belongs to

  std::uint64_t sequence_ = 0;
  Nanoseconds stamp_ns_ = 0;
  std::optional<PosePrior> prior_;
  bool movers_known_ = false;
  bool lost_by_looking_ = false;  // this frame's features alone give no pose
  bool relocalizer_has_frame_ = false;
  Pose T_odom_camera_;
  PoseEstimate estimate_;
  int matched_ = 0, searches_ = 0;
};

}  // namespace stillmap
