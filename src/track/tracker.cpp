// SPDX-License-Identifier: Apache-2.0
#include "track/tracker.h"

#include <algorithm>
#include <cmath>

#include "track/grey.h"
#include "track/keyframe_file.h"
#include "track/pose_covariance.h"
#include "track/rolling_shutter.h"

namespace stillmap {

namespace {

constexpr double kSteady_s = 0.15;   // between two frames, for the turn to be as fast in the later one
constexpr double kLong_s = 0.1;      // between two frames, for a motion model to say little of the later one
constexpr int kFewestToStart = 100;  // points of the first keyframe
constexpr std::size_t kPlaceFeatures = 500;  // of a keyframe, that the place index goes by
constexpr Nanoseconds kKeyframeGap_ns = 60'000'000;
constexpr Nanoseconds kLongestBridge_ns = 200'000'000;  // since the last frame found by points

Pose mount_of(const Config& config) {
  if (!config.mount.T_base_camera) return {};
  return pose_from(*config.mount.T_base_camera);
}

}  // namespace

Tracker::Tracker(Arena& arena, const Config& config)
    : config_(config),
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
      frame_(arena, kMaxFeatures),
      grid_(arena, kMaxFeatures, config.camera),
      map_(arena, static_cast<std::size_t>(config.track.keyframes),
           static_cast<std::size_t>(config.track.points)),
      builder_(config.track, config.camera),
      places_(arena, static_cast<std::size_t>(config.track.keyframes), kPlaceFeatures),
      like_this_(arena, places_),
      localizer_(arena, config, map_, frame_, grid_, extractor_),
      semi_static_(arena, config.track, config.camera, kMaxFeatures),
      motion_check_(arena, config.camera, kMaxFeatures),
      adjustment_(arena, config.camera, static_cast<std::size_t>(config.track.points)),
      loops_(arena, config.track, config.camera, places_),
      readout_(arena, config.camera, static_cast<std::size_t>(config.track.points), kMaxFeatures),
      motion_(T_base_camera_) {
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
  align(slot, predicted);
  Pose T_depth_colour = inverse(predict(slot.depth_ns)) * predicted;
  std::optional<Vec3> turn_rad_per_s;
  if (const double seconds = motion_.seconds_since_pose(slot.colour_ns);
      motion_.has_pose() && seconds > 0 && seconds <= kSteady_s) {
    turn_rad_per_s = (1 / seconds) * log_so3((inverse(motion_.last()) * aligned_).R);
    if (readout_.readout_s() != 0)
      straighten_rows(config_.camera, readout_.readout_s() * *turn_rad_per_s, frame_.features);
    // The picture tells of a jerk that no motion model foresees. How far the camera goes in some milliseconds
    // is left out: where people starve the view, the motion model knows it worst (docs/measurements.md).
    const double skew_s = to_seconds(slot.depth_ns - slot.colour_ns);
    if (alignment_.holds(mask)) T_depth_colour = {exp_so3(-skew_s * *turn_rad_per_s), {}};
  }
  sample_depth(slot.depth, config_.camera, T_depth_colour, frame_.features);
  label_features(mask, T_depth_colour);
  grid_.build(frame_);

  if (result_.state == TrackState::Initializing) {
    start_map(slot);
  } else if (localize(slot, predicted, mask)) {
    if (turn_rad_per_s)
      readout_.observe(frame_.features, matches(), slot.colour_ns, result_.T_odom_camera, *turn_rad_per_s);
    judge();
  } else if (!bridge(slot.colour_ns, mask)) {
    result_.state = TrackState::Lost;
    result_.T_odom_camera = predicted;
    start_segment(slot);
  }
  if (result_.has_pose()) {
    lost_since_ns_ = 0;
    motion_.posed(slot.colour_ns, result_.T_odom_camera);
    if (result_.stands_on_points()) {
      inliers_before_ = result_.inliers;
      found_ns_ = slot.colour_ns;
    }
    if (result_.stands_on_points() && !result_.is_keyframe) {
      if (checks_motion_)
        motion_check_.relabel(frame_, grid_, matches(), slot.colour_ns, result_.T_odom_camera, extractor_);
      builder_.refine_points(map_, posed(slot), extractor_);
      localizer_.count_visible(slot.depth);
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

void Tracker::label_features(const DynamicMask& mask, const Pose& T_depth_colour) {
  // Silhouettes are those of the depth picture, boxes those of the colour picture.
  const bool by_depth = mask.rule == DynamicRule::Silhouette;
  for (Feature& f : frame_.features) {
    const Vec2 own{f.x, f.y};
    const Vec2 at = by_depth ? depth_pixel(config_.camera, T_depth_colour, f).value_or(own) : own;
    f.label = label_at(mask, at.x, at.y, f.depth_m);
  }
}

void Tracker::start_map(const FrameSlot& slot) {
  const auto usable = std::count_if(frame_.features.begin(), frame_.features.end(), [](const Feature& f) {
    return f.label == Label::Static && f.depth_m > 0;
  });
  if (usable < kFewestToStart) return;
  std::ranges::fill(matches(), FeatureMatch{});
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

bool Tracker::localize(const FrameSlot& slot, const Pose& T_odom_camera_predicted, const DynamicMask& mask) {
  const bool was_lost = result_.state == TrackState::Lost;
  const bool long_step = motion_.seconds_since_pose(slot.colour_ns) > kLong_s;
  const std::optional<PosePrior> prior = motion_.prior(slot.colour_ns);
  localizer_.begin(slot.sequence, slot.colour_ns, prior, !mask.boxes.items.empty());
  const PoseGuess guess{T_odom_camera_predicted, aligns_ ? std::optional(aligned_) : std::nullopt, long_step,
                        inliers_before_};
  bool found = (!was_lost || prior) && localizer_.follow(guess);
  if (!found) found = relocalize();
  if (found && config_.track.dynamic_rule != DynamicRule::Off && motion_.has_pose()) {
    semi_static_.relabel(frame_, matches(), inverse(motion_.last()) * localizer_.T_odom_camera(),
                         Random::of(config_.runtime.seed, slot.sequence));
  }
  found = found && localizer_.refine();
  result_.matches = localizer_.matched();
  if (found) result_.T_odom_camera = localizer_.T_odom_camera();
  return found;
}

bool Tracker::found_by(Keyframe& keyframe) {
  const std::optional<FoundPose> found = localizer_.find_by(keyframe);
  const std::uint32_t lost_in = map_.segment();
  const bool elsewhere = keyframe.segment != lost_in;
  if (!found || (elsewhere && !found->sure)) return false;
  map_.enter_segment(keyframe.segment);
  const auto confirmed = [&] { return localizer_.around(inverse(found->T_camera_odom)); };
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
  const PlacesToTry places = places_to_try(like_this_.ask(frame_.descriptors), map_.keyframes());
  return std::ranges::any_of(places, [&](std::size_t slot) { return found_by(map_.keyframes()[slot]); });
}

/// No point tells where the camera is, but the picture as a whole does, from the frame before: for a moment,
/// since each such step adds its error to the last one's. Nothing is learned from it.
bool Tracker::bridge(Nanoseconds stamp_ns, const DynamicMask& mask) {
  if (stamp_ns - found_ns_ > kLongestBridge_ns || !alignment_.holds(mask)) return false;
  std::ranges::fill(matches(), FeatureMatch{});
  result_.state = TrackState::Weak;
  result_.matches = 0;
  result_.rms_px = 0;
  result_.T_odom_camera = aligned_;
  // At its worst the motion model's own.
  const PosePrior step = motion_.step(stamp_ns);
  for (std::size_t i = 0; i < 6; ++i) {
    const double sigma = i < 3 ? step.sigma_rotation_rad : step.sigma_translation_m;
    result_.covariance[7 * i] += sigma * sigma;
  }
  return true;
}

void Tracker::judge() {
  const PoseEstimate& estimate = localizer_.estimate();
  result_.inliers = estimate.inliers;
  result_.rms_px = estimate.rms_px;
  result_.covariance = honest_covariance(estimate, motion_.speed_to(result_.stamp_ns, result_.T_odom_camera),
                                         config_.camera.stamp_sigma_s);
  result_.state = estimate.inliers >= config_.track.weak_inliers ? TrackState::Tracking : TrackState::Weak;
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
  if (closes_loops_) loops_.ask(map_, static_cast<std::size_t>(&keyframe - map_.keyframes().data()));
  stand_on(keyframe);
  keyframe_ns_ = keyframe.stamp_ns;
  result_.is_keyframe = true;
  // What few points hold is better left where the motion model put it.
  if (adjusts_ && result_.state == TrackState::Tracking) adjustment_.offer(map_, extractor_);
}

void Tracker::close_loops(std::uint64_t sequence) {
  const std::optional<Pose> moved = loops_.step(map_, Random::of(config_.runtime.seed, sequence));
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
