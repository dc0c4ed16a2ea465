// SPDX-License-Identifier: Apache-2.0
#include "track/tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "track/grey.h"
#include "track/keyframe_file.h"
#include "track/point_trust.h"
#include "track/pose_covariance.h"
#include "track/rolling_shutter.h"

namespace stillmap {

namespace {

constexpr std::size_t kFeatureCapacity = Keyframe::kMaxFeatures;
// The prediction may be wrong by a jerk of the hand; once solved, only noise is left.
constexpr SearchWindow kAroundPrediction{.radius_px = 16, .max_distance = 70, .depth_share = 0.15};
constexpr SearchWindow kWide{.radius_px = 48, .max_distance = 60, .depth_share = 0.25};
constexpr SearchWindow kAroundSolution{.radius_px = 5, .max_distance = 80, .depth_share = 0.08};
constexpr std::uint64_t kMoment = 30;  // frames
constexpr double kSteady_s = 0.15;     // between two frames, for the turn to be as fast in the later one
constexpr double kLong_s = 0.1;      // between two frames, for a motion model to say little of the later one
constexpr int kSurely = 100;         // inliers that no wrong pose has
constexpr int kPoor = 80;            // fewer, after a frame with thrice as many: perhaps a wrong one
constexpr int kFewestToStart = 100;  // points of the first keyframe
constexpr std::size_t kPlacesPerTry = 2;     // keyframes compared per lost frame, beside the newest
constexpr std::size_t kPlaceFeatures = 500;  // of a keyframe, that the place index goes by
constexpr Nanoseconds kKeyframeGap_ns = 60'000'000;

Pose mount_of(const Config& config) {
  if (!config.mount.T_base_camera) return {};
  return pose_from(*config.mount.T_base_camera);
}

}  // namespace

Tracker::Tracker(Arena& arena, const Config& config)
    : config_(config),
      weighs_trust_(config.track.dynamic_rule == DynamicRule::Silhouette && config.track.has("point_trust")),
      checks_motion_(config.track.dynamic_rule == DynamicRule::Silhouette &&
                     config.track.has("motion_check")),
      aligns_(config.track.has("alignment")),
      adjusts_(config.track.has("adjustment")),
      closes_loops_(config.track.has("loops")),
      T_base_camera_(mount_of(config)),
      grey_{arena
                .take<std::uint8_t>("grey", static_cast<std::size_t>(config.camera.width) *
                                                static_cast<std::size_t>(config.camera.height))
                .data(),
            config.camera.width, config.camera.height, config.camera.width},
      extractor_(arena, config.track, config.camera),
      alignment_(arena, config.camera),
      frame_(arena, kFeatureCapacity),
      grid_(arena, kFeatureCapacity, config.camera),
      map_(arena, static_cast<std::size_t>(config.track.keyframes),
           static_cast<std::size_t>(config.track.points)),
      matcher_(arena, config.track, config.camera),
      builder_(config.track, config.camera),
      places_(arena, static_cast<std::size_t>(config.track.keyframes), kPlaceFeatures),
      relocalizer_(arena, config.track, config.camera),
      semi_static_(arena, config.track, config.camera, kFeatureCapacity),
      motion_check_(arena, config.camera, kFeatureCapacity),
      adjustment_(arena, config.camera, static_cast<std::size_t>(config.track.points)),
      loops_(arena, config.track, config.camera),
      readout_(arena, config.camera, static_cast<std::size_t>(config.track.points), kFeatureCapacity),
      motion_(T_base_camera_),
      matches_(arena.take<FeatureMatch>("matches", kFeatureCapacity)),
      observations_(arena.take<PoseObservation>("pose_observations", kFeatureCapacity)),
      observed_feature_(arena.take<std::uint16_t>("pose_observations.feature", kFeatureCapacity)) {
  result_.T_odom_camera = T_base_camera_;
}

Status Tracker::resume(std::span<const std::byte> keyframes) {
  if (Status s = read_keyframes(keyframes, map_); !s.ok()) return s;
  const Keyframe* newest = map_.newest_keyframe();
  if (newest == nullptr) return Error{ExitCode::UnreadableInput, "holds no keyframes to find the camera by"};
  for (const Keyframe& keyframe : map_.keyframes()) {
    if (!keyframe.alive) continue;
    note_place(keyframe);
    if (keyframe.segment != newest->segment) segment_begin_ = std::max(segment_begin_, keyframe.id + 1);
  }
  stand_on(*newest);
  result_.state = TrackState::Lost;
  return {};
}

void Tracker::stand_on(const Keyframe& keyframe) {
  T_odom_keyframe_ = keyframe.T_odom_camera;
  keyframe_points_ = keyframe.tracked_points;
  result_.reference_keyframe = keyframe.id;
}

void Tracker::note_place(const Keyframe& keyframe) {
  places_.insert(static_cast<std::size_t>(&keyframe - map_.keyframes().data()),
                 std::span<const Descriptor>(keyframe.descriptors).first(keyframe.features.size()));
}

Random Tracker::random_for(std::uint64_t sequence) const {
  return Random(static_cast<std::uint64_t>(config_.runtime.seed) * 0x9e3779b97f4a7c15ULL + sequence);
}

Pose Tracker::predict(Nanoseconds stamp_ns) {
  return motion_.predict(stamp_ns).value_or(result_.T_odom_camera);
}

const TrackingResult& Tracker::track(const FrameSlot& slot, const DynamicMask& mask) {
  take_adjustment();
  const Pose predicted = predict(slot.colour_ns);
  result_.sequence = slot.sequence;
  result_.stamp_ns = slot.colour_ns;
  result_.is_keyframe = false;
  result_.inliers = result_.matches = 0;

  make_grey(slot.colour, grey_);
  alignment_.take(grey_);
  extractor_.extract(grey_, frame_);
  result_.features = static_cast<int>(frame_.features.size());
  const Pose T_depth_colour = inverse(predict(slot.depth_ns)) * predicted;
  sample_depth(slot.depth, config_.camera, T_depth_colour, frame_.features);
  label_features(mask);
  align(slot, predicted);
  std::optional<Vec3> turn_rad_per_s;
  if (const double seconds = motion_.seconds_since_pose(slot.colour_ns);
      motion_.has_pose() && seconds > 0 && seconds <= kSteady_s) {
    turn_rad_per_s = (1 / seconds) * log_so3((inverse(motion_.last()) * aligned_).R);
    if (readout_.readout_s() != 0)
      straighten_rows(config_.camera, readout_.readout_s() * *turn_rad_per_s, frame_.features);
  }
  grid_.build(frame_);
  std::fill(matches_.begin(), matches_.end(), FeatureMatch{});

  if (result_.state == TrackState::Initializing) {
    start_map(slot);
  } else if (localize(slot, predicted)) {
    if (turn_rad_per_s)
      readout_.observe(frame_.features, matches(), slot.colour_ns, result_.T_odom_camera, *turn_rad_per_s);
    judge();
  } else {
    result_.state = TrackState::Lost;
    result_.T_odom_camera = predicted;
    start_segment(slot);
  }
  if (result_.has_pose()) {
    lost_since_ns_ = 0;
    // Not in the keyframe's own frame: that one has enough to do.
    if (unasked_) loops_.ask(map_, *std::exchange(unasked_, std::nullopt), places_);
    motion_.posed(slot.colour_ns, result_.T_odom_camera);
    inliers_before_ = result_.inliers;
    if (!result_.is_keyframe) {
      if (checks_motion_)
        motion_check_.relabel(frame_, grid_, matches(), slot.colour_ns, result_.T_odom_camera, extractor_);
      builder_.refine_points(map_, posed(slot), extractor_);
      matcher_.count_visible(map_, slot.depth);
      if (wants_keyframe()) insert_keyframe(slot);
    }
    close_loops(slot.sequence);
    alignment_.remember(slot.depth, mask);
    motion_check_.remember(frame_, slot.colour_ns, result_.T_odom_camera);
    // Only with a pose: later frames are compared by the motion between.
    semi_static_.remember(frame_, matches());
  } else {
    alignment_.forget();
    readout_.clear();
    motion_check_.clear();
    motion_.lost();
  }
  count_labels();
  return result_;
}

void Tracker::label_features(const DynamicMask& mask) {
  for (Feature& f : frame_.features) f.label = label_at(mask, f.x, f.y, f.depth_m);
}

void Tracker::start_map(const FrameSlot& slot) {
  const auto usable = std::count_if(frame_.features.begin(), frame_.features.end(), [](const Feature& f) {
    return f.label == Label::Static && f.depth_m > 0;
  });
  if (usable < kFewestToStart) return;
  std::fill(matches_.begin(), matches_.end(), FeatureMatch{});
  map_.begin_segment();
  segment_begin_ = map_.next_keyframe_id();
  ++result_.segment;
  result_.state = TrackState::Tracking;
  result_.inliers = static_cast<int>(usable);
  result_.rms_px = 0;
  // A segment's first pose is where it says it is; what is wrong with the map is wrong with all that follow.
  result_.covariance = honest_covariance({}, {}, config_.camera.stamp_sigma_s);
  insert_keyframe(slot);
}

/// Lost where nothing is known: what is seen from now on hangs together, whatever it has to do with the rest.
/// A lens that is covered says nothing of where the camera is: that time does not count.
void Tracker::start_segment(const FrameSlot& slot) {
  if (static_cast<int>(frame_.features.size()) < kFewestToStart) {
    lost_since_ns_ = 0;
    return;
  }
  if (lost_since_ns_ == 0) lost_since_ns_ = slot.colour_ns;
  if (to_seconds(slot.colour_ns - lost_since_ns_) < config_.track.lost_s) return;
  start_map(slot);
}

/// Where the picture as a whole says that the camera is.
void Tracker::align(const FrameSlot& slot, const Pose& T_odom_camera_predicted) {
  aligned_ = T_odom_camera_predicted;
  if (aligns_ && motion_.has_pose())
    aligned_ = motion_.last() * inverse(alignment_.align(motion_.step(slot.colour_ns)));
}

bool Tracker::localize(const FrameSlot& slot, const Pose& T_odom_camera_predicted) {
  const bool was_lost = result_.state == TrackState::Lost;
  prior_ = motion_.prior(slot.colour_ns);
  lost_by_looking_ = false;
  bool found = false;
  if (!was_lost || prior_) {
    found = follow(slot, T_odom_camera_predicted);
    if (!found && prior_) {
      // What there is corrects the motion model instead of replacing it.
      lost_by_looking_ = true;
      matcher_.project(map_, inverse(T_odom_camera_predicted));
      found = match_and_solve(kAroundPrediction, T_odom_camera_predicted);
    }
    if (!found) prior_.reset();
  }
  if (!found) found = relocalize();
  if (!found) return false;

  if (config_.track.dynamic_rule != DynamicRule::Off && motion_.has_pose()) {
    semi_static_.relabel(frame_, matches(), inverse(motion_.last()) * result_.T_odom_camera,
                         random_for(slot.sequence));
  }
  matcher_.reproject(map_, inverse(result_.T_odom_camera));
  return match_and_solve(kAroundSolution, result_.T_odom_camera);
}

bool Tracker::follow(const FrameSlot& slot, const Pose& T_odom_camera_predicted) {
  matcher_.project(map_, inverse(T_odom_camera_predicted));
  const bool found = match_and_solve(kAroundPrediction, T_odom_camera_predicted);
  if (found && estimate_.inliers >= std::min(kPoor, inliers_before_ / 3)) return true;
  // A few wrong matches around a wrong prediction agree now and then. What is poor gives way to what is sure,
  // and else to what most speaks for.
  int most = found ? estimate_.inliers : 0;
  Pose best = found ? result_.T_odom_camera : T_odom_camera_predicted;
  const auto sure = [&](const SearchWindow& window, const Pose& from) {
    matcher_.project(map_, inverse(from));
    if (!match_and_solve(window, from)) return false;
    if (estimate_.inliers > most) {
      most = estimate_.inliers;
      best = result_.T_odom_camera;
    }
    return estimate_.inliers >= kSurely;
  };
  if (aligns_ && sure(kAroundPrediction, aligned_)) return true;
  // Wider, for what was in view a moment ago: all points would take several times as long.
  SearchWindow wide = kWide;
  wide.found_since = result_.sequence - std::min(result_.sequence, kMoment);
  if (sure(wide, T_odom_camera_predicted)) return true;
  // Wherever it may be, after a step of which no motion model knows.
  if (motion_.seconds_since_pose(slot.colour_ns) > kLong_s) {
    relocalizer_.take(frame_);
    const std::optional<FoundPose> by_newest = find_by(*map_.newest_keyframe());
    if (by_newest && sure(kAroundPrediction, inverse(by_newest->T_camera_odom))) return true;
  }
  matcher_.project(map_, inverse(best));
  return most > 0 && match_and_solve(kAroundPrediction, best);
}

bool Tracker::match_and_solve(const SearchWindow& window, const Pose& T_odom_camera) {
  SearchWindow search = window;
  search.any_label = weighs_trust_;
  result_.matches = matcher_.match(map_, frame_, grid_, search, extractor_, matches());
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
    if (weighs_trust_) o.weight = trust_in(point, f.label, result_.stamp_ns);
    observed_feature_[observations_.size()] = static_cast<std::uint16_t>(i);
    static_cast<void>(observations_.try_push_back(o));
  }
  const bool starved = readmit_if_starved(observations_, observed_feature_, frame_.features);
  const PosePrior* prior = prior_ && (starved || lost_by_looking_) ? &*prior_ : nullptr;
  estimate_ = solve_pose(observations_, config_.camera, inverse(T_odom_camera), prior);
  for (std::size_t k = 0; k < observations_.size(); ++k) {
    if (!observations_[k].inlier) matches_[observed_feature_[k]].slot = -1;
  }
  const bool few_will_do = prior != nullptr && lost_by_looking_;
  const int fewest = few_will_do ? config_.track.min_inliers / 2 : config_.track.min_inliers;
  if (!estimate_.converged || estimate_.inliers < fewest) return false;
  result_.T_odom_camera = inverse(estimate_.T_camera_world);
  return true;
}

std::optional<FoundPose> Tracker::find_by(const Keyframe& keyframe) {
  return relocalizer_.find_by(keyframe, random_for(result_.sequence + keyframe.id));
}

bool Tracker::found_by(Keyframe& keyframe) {
  const std::optional<FoundPose> found = find_by(keyframe);
  const std::uint32_t lost_in = map_.segment();
  const bool elsewhere = keyframe.segment != lost_in;
  if (!found || (elsewhere && !found->sure)) return false;
  map_.enter_segment(keyframe.segment);
  const auto confirmed = [&] {
    matcher_.project(map_, found->T_camera_odom);
    return match_and_solve(kAroundPrediction, inverse(found->T_camera_odom));
  };
  bool sure = confirmed();
  if (!sure && found->sure) {
    // Seen long ago, and its points were given up since.
    builder_.revive_points(map_, keyframe, result_.sequence, extractor_);
    sure = confirmed();
  }
  if (!sure) {
    map_.enter_segment(lost_in);
  } else if (elsewhere) {
    stand_on(keyframe);
    segment_begin_ = map_.next_keyframe_id();
  }
  return sure;
}

bool Tracker::relocalize() {
  relocalizer_.take(frame_);
  // The newest keyframe first: most often the camera has only jumped. Then those that look most alike.
  Keyframe* newest = map_.newest_keyframe();
  if (newest != nullptr && found_by(*newest)) return true;
  std::size_t tried = 0;
  for (const PlaceCandidate& place : places_.query(frame_.descriptors)) {
    Keyframe& keyframe = map_.keyframes()[place.slot];
    if (&keyframe == newest) continue;
    if (found_by(keyframe)) return true;
    if (++tried == kPlacesPerTry) break;
  }
  return false;
}

void Tracker::judge() {
  result_.inliers = estimate_.inliers;
  result_.rms_px = estimate_.rms_px;
  result_.covariance =
      honest_covariance(estimate_.covariance, motion_.speed_to(result_.stamp_ns, result_.T_odom_camera),
                        config_.camera.stamp_sigma_s);
  result_.state = estimate_.inliers >= config_.track.weak_inliers ? TrackState::Tracking : TrackState::Weak;
}

bool Tracker::wants_keyframe() const {
  if (std::abs(result_.stamp_ns - keyframe_ns_) < kKeyframeGap_ns) return false;
  const Pose moved = inverse(T_odom_keyframe_) * result_.T_odom_camera;
  constexpr double kTurn_rad = 0.17, kMove_m = 0.12;
  return norm(log_so3(moved.R)) > kTurn_rad || norm(moved.t) > kMove_m ||
         2 * result_.inliers < keyframe_points_;
}

void Tracker::insert_keyframe(const FrameSlot& slot) {
  builder_.cull_points(map_);
  const Keyframe& keyframe = builder_.insert_keyframe(map_, posed(slot), extractor_);
  note_place(keyframe);
  if (closes_loops_) unasked_ = static_cast<std::size_t>(&keyframe - map_.keyframes().data());
  stand_on(keyframe);
  keyframe_ns_ = keyframe.stamp_ns;
  result_.is_keyframe = true;
  // What few points hold is better left where the motion model put it.
  if (adjusts_ && result_.state == TrackState::Tracking) adjustment_.offer(map_, extractor_);
}

void Tracker::close_loops(std::uint64_t sequence) {
  const std::optional<Pose> moved = loops_.step(map_, random_for(sequence));
  if (!moved) return;
  // What lies behind has moved, the newest keyframe and with it odom has not.
  result_.T_map_odom = result_.T_map_odom * *moved;
  ++result_.correction_epoch;
  adjustment_.outdate();
}

void Tracker::describe_keyframes(Correction& out) const {
  out.epoch = result_.correction_epoch;
  out.segment_begin = segment_begin_;
  out.keyframes.clear();
  for (const Keyframe& keyframe : map_.keyframes()) {
    if (keyframe.alive)
      static_cast<void>(
          out.keyframes.try_push_back({keyframe.id, result_.T_map_odom * keyframe.T_odom_camera}));
  }
}

void Tracker::take_adjustment() {
  const std::optional<Pose> move = adjustment_.collect(map_);
  if (!move) return;
  motion_.move(*move);
  result_.T_odom_camera = *move * result_.T_odom_camera;
  T_odom_keyframe_ = *move * T_odom_keyframe_;
}

void Tracker::count_labels() {
  result_.labels = {};
  for (const Feature& f : frame_.features) {
    result_.labels.static_points += f.label == Label::Static;
    result_.labels.dynamic += f.label == Label::Dynamic;
    result_.labels.semi_static += f.label == Label::SemiStatic;
    result_.labels.unknown += f.label == Label::Unknown;
  }
}

}  // namespace stillmap
