// SPDX-License-Identifier: Apache-2.0
#include "track/localizer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "track/map_builder.h"
#include "track/point_trust.h"

namespace stillmap {

namespace {

// The prediction may be wrong by a jerk of the hand; once solved, only noise is left.
constexpr SearchWindow kAroundPrediction{.radius_px = 16, .max_distance = 70, .depth_share = 0.15};
constexpr SearchWindow kAroundSolution{.radius_px = 5, .max_distance = 80, .depth_share = 0.08};
constexpr int kSurely = 100;  // inliers that no wrong pose has
constexpr int kPoor = 80;     // fewer, after a frame with thrice as many: perhaps a wrong one

/// But for the noise of a pose that few points hold.
bool same(const Pose& a, const Pose& b) {
  constexpr double kTurn_rad = 0.0025, kMove_m = 0.0025;
  const Pose between = inverse(a) * b;
  return norm(log_so3(between.R)) < kTurn_rad && norm(between.t) < kMove_m;
}

}  // namespace

Localizer::Localizer(Arena& arena, const Config& config, LocalMap& map, const FrameFeatures& frame,
                     const FeatureGrid& grid, const FeatureExtractor& extractor)
    : config_(config),
      weighs_trust_(config.track.dynamic_rule == DynamicRule::Silhouette && config.track.has("point_trust")),
      samples_(config.track.has("sampling")),
      map_(map),
      frame_(frame),
      grid_(grid),
      extractor_(extractor),
      matcher_(arena, config.track, config.camera),
      relocalizer_(arena, config.track, config.camera),
      matches_(arena.take<FeatureMatch>("matches", kMaxFeatures)),
      best_{{}, 0, arena.take<FeatureMatch>("matches.best", kMaxFeatures)},
      observations_(arena.take<PoseObservation>("pose_observations", kMaxFeatures)),
      observed_feature_(arena.take<std::uint16_t>("pose_observations.feature", kMaxFeatures)) {}

void Localizer::begin(std::uint64_t sequence, Nanoseconds stamp_ns, const std::optional<PosePrior>& prior,
                      bool movers_known) {
  movers_known_ = movers_known;
  sequence_ = sequence;
  stamp_ns_ = stamp_ns;
  prior_ = prior;
  lost_by_looking_ = relocalizer_has_frame_ = false;
  matched_ = searches_ = 0;
  std::ranges::fill(matches_, FeatureMatch{});
}

bool Localizer::follow(const PoseGuess& guess) {
  if (search(guess)) return true;
  // What there is corrects the motion model instead of replacing it.
  lost_by_looking_ = prior_.has_value();
  if (prior_ && around(guess.T_odom_camera)) return true;
  prior_.reset();
  return false;
}

bool Localizer::search(const PoseGuess& guess) {
  const bool found = around(guess.T_odom_camera);
  if (found && estimate_.inliers >= std::min(kPoor, guess.inliers_before / 3)) return true;
  // A few wrong matches around a wrong prediction agree now and then. What is poor gives way to what is sure,
  // and else to what most speaks for.
  best_.estimate = {};
  if (found) keep_best();
  const auto inliers_around = [&](const Pose& T_odom_camera) {
    if (!around(T_odom_camera)) return 0;
    if (estimate_.inliers > best_.estimate.inliers) keep_best();
    return estimate_.inliers;
  };
  if (guess.aligned && !same(*guess.aligned, guess.T_odom_camera)) {
    const Pose first = T_odom_camera_;
    const int inliers = inliers_around(*guess.aligned);
    if (inliers >= kSurely) return true;
    // Two guesses lead to one place: it is the right one, there is only little to see.
    if (found && inliers > 0 && same(first, T_odom_camera_)) return true;
  }
  // Wherever it may be, after a step of which no motion model knows.
  if (guess.long_step) {
    const std::optional<FoundPose> by_newest = find_by(*map_.newest_keyframe());
    if (by_newest && inliers_around(inverse(by_newest->T_camera_odom)) >= kSurely) return true;
  }
  if (best_.estimate.inliers == 0) return false;
  estimate_ = best_.estimate;
  matched_ = best_.matched;
  std::ranges::copy(best_.matches.first(matches().size()), matches().begin());
  T_odom_camera_ = inverse(estimate_.T_camera_world);
  matcher_.project(map_, estimate_.T_camera_world);
  return true;
}

void Localizer::keep_best() {
  best_.estimate = estimate_;
  best_.matched = matched_;
  std::ranges::copy(matches(), best_.matches.begin());
}

std::optional<FoundPose> Localizer::find_by(const Keyframe& keyframe) {
  if (!std::exchange(relocalizer_has_frame_, true)) relocalizer_.take(frame_);
  return relocalizer_.find_by(keyframe, Random::of(config_.runtime.seed, sequence_ + keyframe.id));
}

bool Localizer::around(const Pose& T_odom_camera) {
  matcher_.project(map_, inverse(T_odom_camera));
  return match_and_solve(kAroundPrediction, T_odom_camera);
}

bool Localizer::refine() {
  matcher_.reproject(map_, inverse(T_odom_camera_));
  return match_and_solve(kAroundSolution, T_odom_camera_);
}

bool Localizer::match_and_solve(const SearchWindow& window, const Pose& T_odom_camera) {
  ++searches_;
  SearchWindow search = window;
  search.any_label = weighs_trust_;
  matched_ = matcher_.match(map_, frame_, grid_, search, extractor_, matches());
  observations_.clear();
  for (std::size_t i = 0; i < frame_.features.size(); ++i) {
    if (matches_[i].slot < 0) continue;
    const MapPoint& point = map_.points()[static_cast<std::size_t>(matches_[i].slot)];
    const Feature& f = frame_.features[i];
    PoseObservation o{.p_world = point.p_odom, .ray_x = f.ray_x, .ray_y = f.ray_y};
    o.sigma_px = extractor_.sigma_px(f.octave);
    if (f.depth_m > 0) {
      o.depth_m = f.depth_m;
      const Vec3 axis = T_odom_camera.R * Vec3{0, 0, 1};
      const double sensor = config_.camera.depth_sigma_m(f.depth_m);
      o.sigma_depth_m = std::sqrt(sensor * sensor + variance_along(point, axis));
    }
    if (weighs_trust_) o.weight = trust_in(point, f.label, stamp_ns_);
    observed_feature_[observations_.size()] = static_cast<std::uint16_t>(i);
    static_cast<void>(observations_.try_push_back(o));
  }
  const bool starved = readmit_if_starved(observations_, observed_feature_, frame_.features);
  const PosePrior* prior = prior_ && (starved || lost_by_looking_) ? &*prior_ : nullptr;
  estimate_ = samples_ && movers_known_
                  ? solve_pose_among_outliers(observations_, config_.camera, inverse(T_odom_camera), prior,
                                              Random::of(config_.runtime.seed, sequence_))
                  : solve_pose(observations_, config_.camera, inverse(T_odom_camera), prior);
  for (std::size_t k = 0; k < observations_.size(); ++k) {
    if (!observations_[k].inlier) matches_[observed_feature_[k]].slot = -1;
  }
  const bool few_will_do = prior != nullptr && lost_by_looking_;
  const int fewest = few_will_do ? config_.track.min_inliers / 2 : config_.track.min_inliers;
  if (!estimate_.converged || estimate_.inliers < fewest) return false;
  T_odom_camera_ = inverse(estimate_.T_camera_world);
  return true;
}

}  // namespace stillmap
