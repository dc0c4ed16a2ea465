// SPDX-License-Identifier: Apache-2.0
#include "track/semi_static_check.h"

#include <algorithm>
#include <cmath>

namespace stillmap {

namespace {

constexpr double kSearchPx = 24;
constexpr int kMaxDistance = 60;
constexpr double kLeastParallaxPx = 1.0;

}  // namespace

SemiStaticCheck::SemiStaticCheck(Arena& arena, const Config::Track& config, const CameraModel& camera,
                                 std::size_t feature_capacity)
    : camera_(camera),
      threshold_px_(config.epipolar_threshold_px),
      previous_(arena, feature_capacity),
      previous_grid_(arena, feature_capacity, camera),
      previous_feature_of_slot_(
          arena.take<std::int32_t>("semi_static.feature_of_point", static_cast<std::size_t>(config.points))),
      previous_matches_(arena.take<FeatureMatch>("semi_static.matches", feature_capacity)),
      static_pairs_(arena.take<Correspondence>("semi_static.pairs", feature_capacity)),
      parallax_(arena.take<double>("semi_static.parallax", feature_capacity)) {
  std::fill(previous_feature_of_slot_.begin(), previous_feature_of_slot_.end(), -1);
}

void SemiStaticCheck::collect_static(const FrameFeatures& frame, std::span<const FeatureMatch> inliers) {
  static_pairs_.clear();
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    if (inliers[i].slot < 0 || frame.features[i].label != Label::Static) continue;
    const std::int32_t before = previous_feature_of_slot_[static_cast<std::size_t>(inliers[i].slot)];
    if (before < 0) continue;
    static_cast<void>(static_pairs_.try_push_back(
        {ideal_pixel(previous_.features[static_cast<std::size_t>(before)]), ideal_pixel(frame.features[i])}));
  }
}

double SemiStaticCheck::median_parallax_px(const Pose& T_previous_current) {
  const Mat3 R_current_previous = transposed(T_previous_current.R);
  std::size_t count = 0;
  for (const Correspondence& c : static_pairs_) {
    const Vec3 ray = {(c.first.x - camera_.cx) / camera_.fx, (c.first.y - camera_.cy) / camera_.fy, 1};
    const Vec3 turned = R_current_previous * ray;
    parallax_[count++] = std::hypot(camera_.fx * turned.x / turned.z + camera_.cx - c.second.x,
                                    camera_.fy * turned.y / turned.z + camera_.cy - c.second.y);
  }
  if (count == 0) return 0;
  const auto middle = parallax_.begin() + static_cast<std::ptrdiff_t>(count / 2);
  std::nth_element(parallax_.begin(), middle, parallax_.begin() + static_cast<std::ptrdiff_t>(count));
  return *middle;
}

int SemiStaticCheck::counterpart(const Feature& feature, const Descriptor& descriptor,
                                 const Pose& T_previous_current) const {
  // Where it would have been had only the camera moved; the window leaves room for its own motion.
  const double z = feature.depth_m > 0 ? feature.depth_m : 1e3;
  const Vec3 p = T_previous_current * Vec3{feature.ray_x * z, feature.ray_y * z, z};
  if (p.z <= 0) return -1;
  int best = kMaxDistance + 1, best_index = -1;
  const double u = camera_.fx * p.x / p.z + camera_.cx, v = camera_.fy * p.y / p.z + camera_.cy;
  previous_grid_.for_each_near({}, u, v, kSearchPx, [&](const FeatureGrid::Item& before) {
    const int distance = hamming(descriptor, before.descriptor);
    if (distance < best) {
      best = distance;
      best_index = before.feature;
    }
  });
  return best_index;
}

void SemiStaticCheck::relabel(FrameFeatures& frame, std::span<const FeatureMatch> inliers,
                              const Pose& T_previous_current, Random random) {
  const auto semi_static = [](const Feature& f) { return f.label == Label::SemiStatic; };
  if (previous_.features.empty() || std::none_of(frame.features.begin(), frame.features.end(), semi_static))
    return;
  collect_static(frame, inliers);
  if (median_parallax_px(T_previous_current) < kLeastParallaxPx) return;
  const std::optional<Mat3> F = fundamental_by_ransac(static_pairs_, threshold_px_, random);
  if (!F) return;
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    Feature& feature = frame.features[i];
    if (!semi_static(feature)) continue;
    const int before = counterpart(feature, frame.descriptors[i], T_previous_current);
    if (before < 0) continue;
    const Correspondence pair{ideal_pixel(previous_.features[static_cast<std::size_t>(before)]),
                              ideal_pixel(feature)};
    feature.label = epipolar_distance(*F, pair) > threshold_px_ ? Label::Dynamic : Label::Static;
  }
}

void SemiStaticCheck::remember(const FrameFeatures& frame, std::span<const FeatureMatch> inliers) {
  for (const FeatureMatch& m : previous_matches_) {
    if (m.slot >= 0) previous_feature_of_slot_[static_cast<std::size_t>(m.slot)] = -1;
  }
  previous_matches_.clear();
  previous_.clear();
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    static_cast<void>(previous_.features.try_push_back(frame.features[i]));
    static_cast<void>(previous_.descriptors.try_push_back(frame.descriptors[i]));
    static_cast<void>(previous_matches_.try_push_back(inliers[i]));
    if (inliers[i].slot >= 0)
      previous_feature_of_slot_[static_cast<std::size_t>(inliers[i].slot)] = static_cast<std::int32_t>(i);
  }
  previous_grid_.build(previous_);
}

}  // namespace stillmap
