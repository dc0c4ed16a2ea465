// SPDX-License-Identifier: Apache-2.0
#include "track/motion_check.h"

#include <algorithm>
#include <cmath>

namespace stillmap {

namespace {

constexpr double kSearchPx = 36;  // a quick walk at arm's length, over three frames
constexpr int kMaxDistance = 56;
constexpr double kDistanceRatio = 0.85;
constexpr double kStillPx = 4;  // at octave 0
constexpr double kNeighbourPx = 45;
constexpr double kNeighbourDepthShare = 0.08;
constexpr Nanoseconds kLongestSpan_ns = 150'000'000;  // over more, a camera that steps finds nothing again
constexpr double kCrowded = 0.15;                     // of all verdicts
constexpr double kMostMoving = 0.7;                   // of all verdicts; more is no mover but a wrong pose

}  // namespace

MotionCheck::MotionCheck(Arena& arena, const CameraModel& camera, std::size_t feature_capacity)
    : camera_(camera),
      past_{{{{arena, feature_capacity, camera}},
             {{arena, feature_capacity, camera}},
             {{arena, feature_capacity, camera}}}},
      verdicts_(arena.take<Verdict>("motion_check.verdicts", feature_capacity)) {}

MotionCheck::Verdict MotionCheck::verdict_of(const Feature& feature, const Descriptor& descriptor,
                                             const Past& past, const Pose& T_past_current,
                                             const FeatureExtractor& extractor) const {
  const double z = feature.depth_m;
  const Vec3 p = T_past_current * Vec3{feature.ray_x * z, feature.ray_y * z, z};
  if (p.z < 0.1) return Verdict::Unknown;
  const double u = camera_.fx * p.x / p.z + camera_.cx, v = camera_.fy * p.y / p.z + camera_.cy;
  int best = kMaxDistance + 1, second = 257;
  const FeatureGrid::Item* found = nullptr;
  const double radius_px = kSearchPx * extractor.scale(feature.octave);
  past.grid.for_each_near(beside(feature.octave), u, v, radius_px, [&](const FeatureGrid::Item& before) {
    const int distance = hamming(descriptor, before.descriptor);
    if (distance < best) {
      second = best;
      best = distance;
      found = &before;
    } else if (distance < second) {
      second = distance;
    }
  });
  if (best > kMaxDistance) return Verdict::Unknown;
  const double off = std::hypot(found->u - u, found->v - v);
  if (off < kStillPx * extractor.scale(feature.octave)) return Verdict::Still;
  return best > kDistanceRatio * second ? Verdict::Unknown : Verdict::Moving;
}

bool MotionCheck::neighbours_move(const FeatureGrid& grid, const Feature& f) const {
  int still = 0, moving = 0;
  grid.for_each_near({}, grid.u_of(f), grid.v_of(f), kNeighbourPx, [&](const FeatureGrid::Item& other) {
    if (std::abs(other.depth_m - f.depth_m) > kNeighbourDepthShare * f.depth_m) return;
    still += verdicts_[other.feature] == Verdict::Still;
    moving += verdicts_[other.feature] == Verdict::Moving;
  });
  return moving >= 2 && moving > still;
}

void MotionCheck::relabel(FrameFeatures& frame, const FeatureGrid& grid,
                          std::span<const FeatureMatch> inliers, Nanoseconds stamp_ns,
                          const Pose& T_odom_camera, const FeatureExtractor& extractor) {
  if (count_ < kFrames || stamp_ns - past_[next_].stamp_ns > kLongestSpan_ns) return;
  const Past& past = past_[next_];  // the oldest of them
  const Pose T_past_current = inverse(past.T_odom_camera) * T_odom_camera;
  int still = 0, moving = 0;
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    const Feature& f = frame.features[i];
    verdicts_[i] = Verdict::Unknown;
    if (inliers[i].slot >= 0) {
      verdicts_[i] = Verdict::Still;
    } else if (f.label == Label::Static && f.depth_m > 0) {
      verdicts_[i] = verdict_of(f, frame.descriptors[i], past, T_past_current, extractor);
    }
    still += verdicts_[i] == Verdict::Still;
    moving += verdicts_[i] == Verdict::Moving;
  }
  if (moving > kMostMoving * (moving + still)) {
    for (std::size_t i = 0; i < frame.features.size(); ++i) {
      Feature& f = frame.features[i];
      if (verdicts_[i] != Verdict::Still && f.label == Label::Static) f.label = Label::Unknown;
    }
    return;
  }
  // Where much moves, what could not be checked is not taken on trust either.
  const bool crowded = moving > kCrowded * (moving + still);
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    Feature& f = frame.features[i];
    if (verdicts_[i] == Verdict::Still || f.label != Label::Static || f.depth_m <= 0) continue;
    if (neighbours_move(grid, f)) {
      f.label = Label::Dynamic;
    } else if (crowded) {
      f.label = Label::Unknown;
    }
  }
}

void MotionCheck::remember(const FrameFeatures& frame, Nanoseconds stamp_ns, const Pose& T_odom_camera) {
  Past& past = past_[next_];
  past.grid.build(frame);
  past.stamp_ns = stamp_ns;
  past.T_odom_camera = T_odom_camera;
  next_ = (next_ + 1) % kFrames;
  count_ = std::min(count_ + 1, kFrames);
}

}  // namespace stillmap
