// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "scene.h"
#include "track/feature_extractor.h"
#include "track/local_map.h"
#include "track/projection_matcher.h"

namespace stillmap::test {

/// Made-up frames of made-up points: the parts behind the picture code, with every number known.
struct PosedScene {
  Config config = synthetic_config();
  CameraModel camera = config.camera;
  Arena arena{std::size_t{192} << 20};
  FeatureExtractor extractor{arena, config.track, camera};  // for its scales
  FrameFeatures frame{arena, kMaxFeatures};
  LocalMap map{arena, 16, static_cast<std::size_t>(config.track.points)};
  std::vector<FeatureMatch> matches;
  Random random{11};

  /// Adds a feature that sees `p_camera`, matched to `slot`.
  void see(Vec3 p_camera, const Descriptor& descriptor, Label label = Label::Static, std::int32_t slot = -1,
           int octave = 0) {
    Feature f = feature_of(camera, p_camera, label);
    f.octave = static_cast<std::uint8_t>(octave);
    ASSERT_TRUE(frame.features.try_push_back(f));
    ASSERT_TRUE(frame.descriptors.try_push_back(descriptor));
    matches.push_back({slot, 0});
  }
  void clear_frame() {
    frame.clear();
    matches.clear();
  }
  /// A point of the map, last described from `camera_position`.
  PointRef add_point(Vec3 p_odom, const Descriptor& descriptor, Vec3 camera_position = {}, int octave = 0) {
    MapPoint point;
    point.p_odom = p_odom;
    point.descriptor = descriptor;
    point.reference_distance_m = norm(camera_position - p_odom);
    point.view_direction = 1 / point.reference_distance_m * (camera_position - p_odom);
    point.reference_octave = static_cast<std::uint8_t>(octave);
    point.information = {1e4, 0, 0, 1e4, 0, 1e4};
    point.visible = point.found = 1;
    return map.add_point(point);
  }
  Vec3 anywhere_in_view() {
    const double z = 1 + 3 * random.uniform();
    return {(random.uniform() - 0.5) * 1.1 * z, (random.uniform() - 0.5) * 0.85 * z, z};
  }
};

}  // namespace stillmap::test
