// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/config.h"
#include "core/frame_pool.h"
#include "track/feature_extractor.h"
#include "track/feature_grid.h"
#include "track/local_map.h"

namespace stillmap {

/// Which map point each feature of a frame was matched to: `slot` into LocalMap::points(), -1 for none.
struct FeatureMatch {
  std::int32_t slot = -1;
  std::int32_t distance = 0;  ///< Hamming
};

/// How wide a search is.
struct SearchWindow {
  double radius_px = 8;      ///< at octave 0; grows with the octave's scale
  int max_distance = 64;     ///< Hamming, of 256
  bool any_label = false;    ///< match Dynamic and Unknown features too
  double depth_share = 0.1;  ///< a feature whose depth differs by more than this share of it is another thing
};

/// Finds map points in a frame by projecting them with a predicted pose. Used by one thread; no heap after
/// construction.
class ProjectionMatcher {
 public:
  ProjectionMatcher(Arena& arena, const Config::Track& config, const CameraModel& camera);

  /// Projects every living point of the map's newest segment with `T_camera_odom` and keeps what falls into
  /// the picture at an octave and angle at which it can be recognised. Call before `match`.
  void project(const LocalMap& map, const Pose& T_camera_odom);
  /// Projects what `project` kept once more, with a pose that is better known: cheaper, since most of the map
  /// is out of view.
  void reproject(const LocalMap& map, const Pose& T_camera_odom);
  /// Matches what was projected to features that may be used (Static, SemiStatic). A feature takes the
  /// point nearest in descriptor. Returns the number of matches; `matches` has one entry per feature.
  int match(const LocalMap& map, const FrameFeatures& frame, const FeatureGrid& grid,
            const SearchWindow& window, const FeatureExtractor& extractor,
            std::span<FeatureMatch> matches) const;
  /// Counts, for every point that was projected and nothing nearer hides, that it should have been seen.
  void count_visible(LocalMap& map, ImageView<const std::uint16_t> depth) const;

 private:
  struct Candidate;
  bool project_point(const MapPoint& point, const Pose& T_camera_odom, Vec3 camera_centre,
                     Candidate& out) const;
  struct Candidate {
    std::int32_t slot;
    std::int32_t octave;
    double u, v, z;  // ideal pixels, metres
  };
  CameraModel camera_;
  double log_scale_;
  int levels_;
  ArenaVector<Candidate> candidates_;
};

}  // namespace stillmap
