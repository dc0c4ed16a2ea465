// SPDX-License-Identifier: Apache-2.0
// Extraction beside cv::ORB, matching beside brute force, the pose beside one without weights and outlier
// rounds.
#include <benchmark/benchmark.h>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <opencv2/features2d.hpp>

#include "scene.h"
#include "track/feature_extractor.h"
#include "track/feature_grid.h"
#include "track/local_map.h"
#include "track/pose_solver.h"
#include "track/projection_matcher.h"

namespace stillmap {
namespace {

const test::Scene& scene() {
  static const test::Scene one = [] {
    synthetic::SyntheticLog log({.seed = 3, .people = 2});
    return test::Scene(log, 10);
  }();
  return one;
}

void extraction(benchmark::State& state) {
  const Config config = test::synthetic_config();
  Arena arena(test::kArenaBytes);
  FeatureExtractor extractor(arena, config.track, config.camera);
  FrameFeatures features(arena, 1200);
  const auto grey = scene().grey.view();
  for (auto _ : state) extractor.extract(grey, features);
  state.counters["features"] = static_cast<double>(features.features.size());
}
void extraction_baseline_cv_orb(benchmark::State& state) {
  const Config config = test::synthetic_config();
  const auto grey = scene().grey.view();
  const cv::Mat image(grey.height, grey.width, CV_8U, const_cast<std::uint8_t*>(grey.data));
  const auto orb = cv::ORB::create(config.track.features, static_cast<float>(config.track.scale_factor),
                                   config.track.levels);
  cv::setNumThreads(1);
  std::vector<cv::KeyPoint> corners;
  cv::Mat descriptors;
  for (auto _ : state) orb->detectAndCompute(image, {}, corners, descriptors);
  state.counters["features"] = static_cast<double>(corners.size());
}
BENCHMARK(extraction)->Unit(benchmark::kMicrosecond);
BENCHMARK(extraction_baseline_cv_orb)->Unit(benchmark::kMicrosecond);

/// A map of 4000 points, 1000 of which are seen exactly by a frame from its origin.
struct Matching {
  Matching() {
    Random random(7);
    for (int i = 0; i < 4000; ++i) {
      const bool seen = i % 4 == 0;
      const double z = 1 + 3 * random.uniform();
      const Vec3 p{(random.uniform() - 0.5) * z, (random.uniform() - 0.5) * 0.8 * z, seen ? z : -z};
      MapPoint point;
      point.p_odom = p;
      point.descriptor = test::random_descriptor(random);
      point.reference_distance_m = norm(p);
      point.view_direction = -1 / norm(p) * p;
      point.information = {1e4, 0, 0, 1e4, 0, 1e4};
      static_cast<void>(map.add_point(point));
      if (!seen) continue;
      static_cast<void>(frame.features.try_push_back(test::feature_of(config.camera, p)));
      static_cast<void>(frame.descriptors.try_push_back(point.descriptor));
    }
    grid.build(frame);
    matches.resize(frame.features.size());
  }
  Config config = test::synthetic_config();
  Arena arena{std::size_t{192} << 20};
  FeatureExtractor extractor{arena, config.track, config.camera};
  FrameFeatures frame{arena, 1200};
  LocalMap map{arena, 16, 20'000};
  FeatureGrid grid{arena, 1200, config.camera};
  ProjectionMatcher matcher{arena, config.track, config.camera};
  std::vector<FeatureMatch> matches;
};

void matching(benchmark::State& state) {
  Matching m;
  int found = 0;
  for (auto _ : state) {
    m.matcher.project(m.map, Pose{});
    std::fill(m.matches.begin(), m.matches.end(), FeatureMatch{});
    found = m.matcher.match(m.map, m.frame, m.grid, {.radius_px = 16}, m.extractor, m.matches);
  }
  state.counters["matches"] = found;
}
void matching_baseline_brute_force(benchmark::State& state) {
  Matching m;
  int found = 0;
  for (auto _ : state) {
    found = 0;
    for (const Descriptor& mine : m.frame.descriptors) {
      int best = 257;
      for (const MapPoint& point : m.map.points()) best = std::min(best, hamming(mine, point.descriptor));
      found += best <= 64;
    }
  }
  state.counters["matches"] = found;
}
BENCHMARK(matching)->Unit(benchmark::kMicrosecond);
BENCHMARK(matching_baseline_brute_force)->Unit(benchmark::kMicrosecond);

/// 600 observations with noise, a tenth of them wrong.
std::vector<PoseObservation> observations(const CameraModel& camera) {
  Random random(5);
  std::vector<PoseObservation> all;
  for (int i = 0; i < 600; ++i) {
    const double z = 1 + 3 * random.uniform();
    const Vec3 p{(random.uniform() - 0.5) * z, (random.uniform() - 0.5) * 0.8 * z, z};
    PoseObservation o{.p_world = p, .ray_x = p.x / z, .ray_y = p.y / z, .depth_m = z, .sigma_depth_m = 0.01};
    o.ray_x += (i % 10 == 0 ? 40 : 0.8) * test::gaussian(random) / camera.fx;
    o.ray_y += 0.8 * test::gaussian(random) / camera.fy;
    all.push_back(o);
  }
  return all;
}
const Pose kStart{rotation_from({1, 0.02, -0.01, 0.01}), {0.03, -0.02, 0.04}};

void pose(benchmark::State& state) {
  const CameraModel camera = test::synthetic_config().camera;
  const auto all = observations(camera);
  PoseEstimate found;
  for (auto _ : state) {
    auto work = all;
    found = solve_pose(work, camera, kStart);
  }
  state.counters["error_mm"] = 1000 * norm(found.T_camera_world.t);
}
/// Twenty plain Gauss-Newton steps on reprojection and depth: no robust weights, nothing thrown out.
void pose_baseline_least_squares(benchmark::State& state) {
  const CameraModel camera = test::synthetic_config().camera;
  const auto all = observations(camera);
  Pose T;
  for (auto _ : state) {
    T = kStart;
    for (int step = 0; step < 20; ++step) {
      Eigen::Matrix<double, 6, 6> H = Eigen::Matrix<double, 6, 6>::Zero();
      Eigen::Matrix<double, 6, 1> b = Eigen::Matrix<double, 6, 1>::Zero();
      for (const PoseObservation& o : all) {
        const Vec3 p = T * o.p_world;
        const double iz = 1 / p.z;
        const std::array<Vec3, 3> gradients{Vec3{camera.fx * iz, 0, -camera.fx * p.x * iz * iz},
                                            Vec3{0, camera.fy * iz, -camera.fy * p.y * iz * iz},
                                            Vec3{0, 0, 1 / o.sigma_depth_m}};
        const std::array<double, 3> residuals{camera.fx * (p.x * iz - o.ray_x),
                                              camera.fy * (p.y * iz - o.ray_y),
                                              (p.z - o.depth_m) / o.sigma_depth_m};
        for (std::size_t r = 0; r < 3; ++r) {
          const Vec3 g = gradients[r], w = cross(p, g);
          Eigen::Matrix<double, 6, 1> row;
          row << w.x, w.y, w.z, g.x, g.y, g.z;
          H += row * row.transpose();
          b -= row * residuals[r];
        }
      }
      const Eigen::Matrix<double, 6, 1> d = H.ldlt().solve(b);
      T = Pose{exp_so3({d[0], d[1], d[2]}), {d[3], d[4], d[5]}} * T;
    }
  }
  state.counters["error_mm"] = 1000 * norm(T.t);
}
BENCHMARK(pose)->Unit(benchmark::kMicrosecond);
BENCHMARK(pose_baseline_least_squares)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace stillmap
