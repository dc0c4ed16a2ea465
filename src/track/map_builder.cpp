// SPDX-License-Identifier: Apache-2.0
#include "track/map_builder.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <limits>

namespace stillmap {

namespace {

// What the pose itself adds to a point's error. Keeps hundreds of repeated looks from making a point seem
// certain.
constexpr double kPoseSigma_m = 0.004;
constexpr std::uint16_t kSettledAfter = 40;  // measurements after which a point keeps its place

Eigen::Matrix3d information_of(const MapPoint& point) {
  return Eigen::Matrix3d(whole(point.information).m.data());  // symmetric: its order does not matter
}

/// Information of one measurement: sharp across the ray, and along it as sharp as the depth sensor.
template <class AnyFeature>
Eigen::Matrix3d measurement_information(const AnyFeature& f, const Pose& T_odom_camera,
                                        const CameraModel& camera, double scale) {
  const double lateral = f.depth_m * scale / camera.fx, depth = camera.depth_sigma_m(f.depth_m);
  const double a = 1 / (lateral * lateral + kPoseSigma_m * kPoseSigma_m),
               b = 1 / (depth * depth + kPoseSigma_m * kPoseSigma_m);
  const Vec3 ray = T_odom_camera.R * Vec3{f.ray_x, f.ray_y, 1};
  const Eigen::Vector3d r = Eigen::Vector3d(ray.x, ray.y, ray.z).normalized();
  return a * Eigen::Matrix3d::Identity() + (b - a) * r * r.transpose();
}

template <class AnyFeature>
Vec3 measured_position(const AnyFeature& f, const Pose& T_odom_camera) {
  return T_odom_camera * Vec3{f.ray_x * f.depth_m, f.ray_y * f.depth_m, f.depth_m};
}

}  // namespace

double variance_along(const MapPoint& point, Vec3 direction) {
  const Eigen::Matrix3d information = information_of(point);
  const Eigen::Vector3d d(direction.x, direction.y, direction.z);
  return d.dot(information.inverse() * d);
}

bool MapBuilder::enters_map(const Feature& feature) const {
  if (feature.depth_m <= 0) return false;
  // Beyond the paper: what may move enters too, on probation. Someone who sits still is worth as much as a
  // wall.
  return feature.label == Label::Static || config_.dynamic_rule == DynamicRule::Silhouette;
}

MapPoint MapBuilder::new_point(const Keyframe& keyframe, const KeyframeFeature& f,
                               const Descriptor& descriptor, const FeatureExtractor& extractor) const {
  MapPoint point;
  point.p_odom = measured_position(f, keyframe.T_odom_camera);
  point.information =
      upper_triangle(measurement_information(f, keyframe.T_odom_camera, camera_, extractor.scale(f.octave)));
  const Vec3 to_camera = keyframe.T_odom_camera.t - point.p_odom;
  point.reference_distance_m = norm(to_camera);
  point.view_direction = 1 / point.reference_distance_m * to_camera;
  point.descriptor = descriptor;
  point.reference_octave = f.octave;
  point.visible = point.found = 1;
  point.last_found_sequence = keyframe.sequence;
  point.made_ns = keyframe.stamp_ns;
  return point;
}

Keyframe& MapBuilder::insert_keyframe(LocalMap& map, const PosedFeatures& posed,
                                      const FeatureExtractor& extractor) const {
  Keyframe& keyframe = map.add_keyframe();
  keyframe.sequence = posed.sequence;
  keyframe.stamp_ns = posed.stamp_ns;
  keyframe.T_odom_camera = posed.T_odom_camera;
  keyframe.tracked_points = 0;
  // Culling may have removed a point that this frame stands on; its slot may soon be another point's.
  for (FeatureMatch& m : posed.inliers) {
    if (m.slot >= 0 && !map.points()[static_cast<std::size_t>(m.slot)].alive) m.slot = -1;
  }
  for (std::size_t i = 0; i < posed.frame.features.size(); ++i) {
    const Feature& f = posed.frame.features[i];
    KeyframeFeature kept{f.ray_x, f.ray_y, f.depth_m, f.octave, {}};
    FeatureMatch& match = posed.inliers[i];
    if (match.slot >= 0) {
      MapPoint& point = map.points()[static_cast<std::size_t>(match.slot)];
      kept.point = {match.slot, point.id};
      // The newest look describes the point: it is the one that the next frames resemble.
      point.descriptor = posed.frame.descriptors[i];
      const Vec3 to_camera = posed.T_odom_camera.t - point.p_odom;
      point.reference_distance_m = norm(to_camera);
      point.view_direction = 1 / point.reference_distance_m * to_camera;
      point.reference_octave = f.octave;
    } else if (enters_map(f)) {
      MapPoint point = new_point(keyframe, kept, posed.frame.descriptors[i], extractor);
      point.suspect = f.label != Label::Static;
      kept.point = map.add_point(point);
      match.slot = kept.point.slot;
    }
    keyframe.tracked_points += kept.point.slot >= 0;
    keyframe.descriptors[keyframe.features.size()] = posed.frame.descriptors[i];
    if (!keyframe.features.try_push_back(kept)) break;
  }
  return keyframe;
}

void MapBuilder::revive_points(LocalMap& map, Keyframe& keyframe, std::uint64_t sequence,
                               const FeatureExtractor& extractor) const {
  for (std::size_t i = 0; i < keyframe.features.size(); ++i) {
    KeyframeFeature& f = keyframe.features[i];
    // A loaded keyframe does not know which of its features had a point; by the silhouette rule all had.
    const bool had_point = f.point.slot >= 0 || config_.dynamic_rule == DynamicRule::Silhouette;
    if (!had_point || f.depth_m <= 0 || map.find(f.point) != nullptr) continue;
    MapPoint point = new_point(keyframe, f, keyframe.descriptors[i], extractor);
    point.suspect = true;
    point.last_found_sequence = sequence;
    f.point = map.add_point(point);
  }
}

void MapBuilder::refine_points(LocalMap& map, const PosedFeatures& posed,
                               const FeatureExtractor& extractor) const {
  for (std::size_t i = 0; i < posed.frame.features.size(); ++i) {
    if (posed.inliers[i].slot < 0) continue;
    MapPoint& point = map.points()[static_cast<std::size_t>(posed.inliers[i].slot)];
    if (point.found < std::numeric_limits<std::uint16_t>::max()) ++point.found;
    point.last_found_sequence = posed.sequence;
    const Feature& f = posed.frame.features[i];
    if (f.depth_m <= 0 || point.found > kSettledAfter) continue;
    const Eigen::Matrix3d measured =
        measurement_information(f, posed.T_odom_camera, camera_, extractor.scale(f.octave));
    const Eigen::Matrix3d sum = information_of(point) + measured;
    const Vec3 offset = measured_position(f, posed.T_odom_camera) - point.p_odom;
    const Eigen::Vector3d step = sum.inverse() * (measured * Eigen::Vector3d(offset.x, offset.y, offset.z));
    point.p_odom = point.p_odom + Vec3{step[0], step[1], step[2]};
    point.information = upper_triangle(sum);
  }
}

void MapBuilder::cull_points(LocalMap& map) const {
  constexpr int kFewestLooks = 5;
  constexpr double kFoundShare = 0.25;
  const std::span<MapPoint> points = map.points();
  for (std::size_t i = 0; i < points.size(); ++i) {
    MapPoint& p = points[i];
    if (p.alive && p.visible >= kFewestLooks && p.found < kFoundShare * p.visible) map.remove_point(i);
  }
}

}  // namespace stillmap
