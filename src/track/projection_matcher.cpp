// SPDX-License-Identifier: Apache-2.0
#include "track/projection_matcher.h"

#include <algorithm>
#include <cmath>

namespace stillmap {

namespace {

constexpr double kNearest_m = 0.1;
constexpr double kSteepest =
    0.5;  // cosine of the largest turn of a surface at which its corner looks the same
constexpr double kDistanceRatio =
    0.85;  // the best match must be this much better than the next of its octave

bool usable(Label label) {
  return label == Label::Static || label == Label::SemiStatic;
}

}  // namespace

ProjectionMatcher::ProjectionMatcher(Arena& arena, const Config::Track& config, const CameraModel& camera)
    : camera_(camera),
      log_scale_(std::log(config.scale_factor)),
      levels_(config.levels),
      candidates_(arena.take<Candidate>("match_candidates", static_cast<std::size_t>(config.points))) {}

/// Fills all of `out` but the slot; false where the point cannot be seen or not be recognised.
bool ProjectionMatcher::project_point(const MapPoint& point, const Pose& T_camera_odom, Vec3 camera_centre,
                                      Candidate& out) const {
  const Vec3 p = T_camera_odom * point.p_odom;
  if (p.z < kNearest_m) return false;
  out.u = camera_.fx * p.x / p.z + camera_.cx;
  out.v = camera_.fy * p.y / p.z + camera_.cy;
  out.z = p.z;
  // Undistorted coordinates may lie somewhat outside the picture where the lens bends inwards.
  const double margin = 0.1 * camera_.width;
  if (out.u < -margin || out.v < -margin || out.u > camera_.width + margin || out.v > camera_.height + margin)
    return false;
  const Vec3 to_camera = camera_centre - point.p_odom;
  const double distance = norm(to_camera);
  if (dot(to_camera, point.view_direction) < kSteepest * distance) return false;
  const double octave = point.reference_octave + std::log(point.reference_distance_m / distance) / log_scale_;
  out.octave = std::clamp(static_cast<int>(std::lround(octave)), 0, levels_ - 1);
  return octave >= -1 && octave <= levels_;
}

void ProjectionMatcher::project(const LocalMap& map, const Pose& T_camera_odom) {
  candidates_.clear();
  const Vec3 camera_centre = inverse(T_camera_odom).t;
  const std::span<const MapPoint> points = map.points();
  Candidate candidate;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!points[i].alive || !map.in_segment(points[i]) ||
        !project_point(points[i], T_camera_odom, camera_centre, candidate))
      continue;
    candidate.slot = static_cast<std::int32_t>(i);
    static_cast<void>(candidates_.try_push_back(candidate));
  }
}

void ProjectionMatcher::reproject(const LocalMap& map, const Pose& T_camera_odom) {
  const Vec3 camera_centre = inverse(T_camera_odom).t;
  std::size_t kept = 0;
  for (Candidate candidate : candidates_) {
    const MapPoint& point = map.points()[static_cast<std::size_t>(candidate.slot)];
    if (project_point(point, T_camera_odom, camera_centre, candidate)) candidates_[kept++] = candidate;
  }
  candidates_.resize_down(kept);
}

int ProjectionMatcher::match(const LocalMap& map, const FrameFeatures& frame, const FeatureGrid& grid,
                             const SearchWindow& window, const FeatureExtractor& extractor,
                             std::span<FeatureMatch> matches) const {
  std::fill(matches.begin(), matches.end(), FeatureMatch{});
  int count = 0;
  for (const Candidate& c : candidates_) {
    const MapPoint& point = map.points()[static_cast<std::size_t>(c.slot)];
    int best = 257, second = 257;
    std::size_t best_feature = 0;
    int best_octave = -1, second_octave = -1;
    const double radius_px = window.radius_px * extractor.scale(c.octave);
    grid.for_each_near(beside(c.octave), c.u, c.v, radius_px, [&](const FeatureGrid::Item& f) {
      if (!window.any_label && !usable(frame.features[f.feature].label)) return;
      if (f.depth_m > 0 && std::abs(f.depth_m - c.z) > window.depth_share * c.z) return;
      const int distance = hamming(point.descriptor, f.descriptor);
      if (distance < best) {
        second = best;
        second_octave = best_octave;
        best = distance;
        best_octave = f.octave;
        best_feature = f.feature;
      } else if (distance < second) {
        second = distance;
        second_octave = f.octave;
      }
    });
    if (best > window.max_distance) continue;
    if (second_octave == best_octave && best > kDistanceRatio * second) continue;
    FeatureMatch& m = matches[best_feature];
    if (m.slot >= 0 && m.distance <= best) continue;
    count += m.slot < 0;
    m = {c.slot, best};
  }
  return count;
}

void ProjectionMatcher::count_visible(LocalMap& map, ImageView<const std::uint16_t> depth) const {
  constexpr double kNearerShare = 0.05;
  for (const Candidate& c : candidates_) {
    const Vec2 pixel =
        camera_.project({(c.u - camera_.cx) / camera_.fx * c.z, (c.v - camera_.cy) / camera_.fy * c.z, c.z});
    const int x = static_cast<int>(std::lround(pixel.x)), y = static_cast<int>(std::lround(pixel.y));
    if (!depth.contains(x, y)) continue;
    const double measured = camera_.depth_m(depth.at(x, y));
    if (measured > 0 && measured < c.z * (1 - kNearerShare)) continue;  // something stands before it
    MapPoint& point = map.points()[static_cast<std::size_t>(c.slot)];
    // Halve the counts now and then, so that the share speaks of the recent past and no count overflows.
    if (++point.visible > 200) {
      point.visible = static_cast<std::uint16_t>(point.visible / 2);
      point.found = static_cast<std::uint16_t>(point.found / 2);
    }
  }
}

}  // namespace stillmap
