// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_log/synthetic_log.h"

#include "tests/support/synthetic_log/materials.h"
#include "tests/support/synthetic_log/sensor.h"

namespace stillmap::synthetic {

namespace {

constexpr Nanoseconds kStart_ns = 1'000'000'000'000;
constexpr double kExposure_s = 0.012;
/// Parts of the exposure, each seen through another part of the pixel: motion blur and smooth edges in one.
constexpr std::array<Vec2, 4> kSubPixels{
    {{-0.125, -0.375}, {0.375, -0.125}, {-0.375, 0.125}, {0.125, 0.375}}};

}  // namespace

SyntheticLog::SyntheticLog(const SyntheticOptions& options)
    : options_(options), path_(options.seed, options.path), room_(make_room(options.seed)) {
  for (int i = 0; i < options.people; ++i) walkers_.emplace_back(options.seed, i, path_);
}

CameraModel SyntheticLog::camera() {
  CameraModel camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 525;
  camera.cx = 319.5;
  camera.cy = 239.5;
  camera.depth_units_per_m = 5000;
  camera.readout_s = 0;  // rendered at one instant
  return camera;
}

Nanoseconds SyntheticLog::stamp_ns(int index) const {
  // Whole microseconds, as the log's text has them.
  return kStart_ns + (static_cast<Nanoseconds>(index) * 1'000'000 / 30) * 1000;
}

Pose SyntheticLog::T_world_camera(Nanoseconds stamp_ns) const {
  return path_.T_world_camera(to_seconds(stamp_ns - kStart_ns));
}

void SyntheticLog::look(double t_s, double x_offset_px, double y_offset_px) {
  shapes_ = room_.furniture;
  for (const Walker& walker : walkers_) walker.add_shapes(t_s, shapes_);
  caster_->look(path_.T_world_camera(t_s), shapes_, x_offset_px, y_offset_px);
}

void SyntheticLog::render(int index, SyntheticFrame& frame) {
  const CameraModel camera = SyntheticLog::camera();
  const auto pixels = static_cast<std::size_t>(camera.width * camera.height);
  frame.stamp_ns = stamp_ns(index);
  frame.T_world_camera = T_world_camera(frame.stamp_ns);
  frame.colour.resize(pixels);
  frame.depth.resize(pixels);
  frame.mask.resize(pixels);
  frame.true_depth_m.resize(pixels);

  if (!caster_) {
    materials_ = make_materials(options_.seed);
    caster_.emplace(camera, room_.shell, materials_);
  }
  const double t_s = to_seconds(frame.stamp_ns - kStart_ns);
  look(t_s, 0, 0);
  caster_->cast(frame.true_depth_m, frame.mask);
  sums_.assign(pixels, {});
  for (std::size_t i = 0; i < kSubPixels.size(); ++i) {
    const double share = (static_cast<double>(i) + 0.5) / static_cast<double>(kSubPixels.size()) - 0.5;
    look(t_s + (options_.noise ? share * kExposure_s : 0), kSubPixels[i].x, kSubPixels[i].y);
    caster_->add_colour(sums_);
  }

  Random random(options_.seed, 1'000'000 + static_cast<std::uint64_t>(index));
  measure_colour(sums_, static_cast<int>(kSubPixels.size()), options_.noise ? &random : nullptr,
                 frame.colour);
  if (options_.noise) {
    measure_depth(frame.true_depth_m, camera, random, frame.depth);
  } else {
    measure_depth_ideally(frame.true_depth_m, camera, frame.depth);
  }
}

}  // namespace stillmap::synthetic
