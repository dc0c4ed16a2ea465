// SPDX-License-Identifier: Apache-2.0
#include "map/keyframe_copies.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap {

namespace {

constexpr int kOffset = KeyframeCopies::kStep / 2;  // the pixel that is taken of each square of them

CameraModel small_camera_of(const CameraModel& camera) {
  constexpr double kStep = KeyframeCopies::kStep;
  CameraModel small = camera;
  small.width = camera.width / KeyframeCopies::kStep;
  small.height = camera.height / KeyframeCopies::kStep;
  small.fx = camera.fx / kStep;
  small.fy = camera.fy / kStep;
  small.cx = (camera.cx - kOffset) / kStep;
  small.cy = (camera.cy - kOffset) / kStep;
  return small;
}

std::int16_t to_mm(float z_m) {
  constexpr float kFarthest_mm = std::numeric_limits<std::int16_t>::max();
  return static_cast<std::int16_t>(std::clamp(std::round(1000 * z_m), -kFarthest_mm, kFarthest_mm));
}

}  // namespace

KeyframeCopies::KeyframeCopies(Arena& arena, const CameraModel& camera, std::size_t copies)
    : small_(small_camera_of(camera)),
      width_(static_cast<std::size_t>(camera.width)),
      copies_(arena.take<Copy>("map_keyframe_copies", copies)) {
  const std::size_t pixels = static_cast<std::size_t>(small_.width) * static_cast<std::size_t>(small_.height);
  const std::span<std::int16_t> z_mm = arena.take<std::int16_t>("map_keyframe_depths", copies * pixels);
  const std::span<Bgr> colour = arena.take<Bgr>("map_keyframe_colours", copies * pixels);
  for (std::size_t i = 0; i < copies_.size(); ++i) {
    copies_[i].z_mm = z_mm.subspan(i * pixels, pixels);
    copies_[i].colour = colour.subspan(i * pixels, pixels);
  }
}

bool KeyframeCopies::has(std::uint32_t keyframe) const {
  return std::ranges::any_of(copies(), [=](const Copy& c) { return c.keyframe == keyframe; });
}

std::size_t KeyframeCopies::least_missed() const {
  const auto newest = std::ranges::max_element(copies(), {}, &Copy::keyframe);
  double least_apart = std::numeric_limits<double>::max();
  std::size_t chosen = 0;
  for (std::size_t i = 0; i < used_; ++i) {
    if (&copies_[i] == &*newest) continue;
    for (std::size_t j = 0; j < used_; ++j) {
      if (i == j) continue;
      const Pose T = inverse(copies_[i].T_map_camera_depth) * copies_[j].T_map_camera_depth;
      const double apart = norm(T.t) + norm(log_so3(T.R));  // a metre weighs as much as a radian
      if (apart >= least_apart) continue;
      least_apart = apart;
      chosen = i;
    }
  }
  return chosen;
}

void KeyframeCopies::add(std::uint32_t keyframe, const Pose& T_map_camera_depth,
                         const Pose& T_map_camera_colour, std::span<const float> z_m,
                         ImageView<const Bgr> colour) {
  if (copies_.empty()) return;
  const bool full = used_ == copies_.size();
  Copy& copy = copies_[full ? least_missed() : used_++];
  replaced_ += full;
  copy.keyframe = keyframe;
  copy.T_map_camera_depth = T_map_camera_depth;
  copy.T_map_camera_colour = T_map_camera_colour;
  std::size_t to = 0;
  for (int y = 0; y < small_.height; ++y) {
    const int from_y = kStep * y + kOffset;
    for (int x = 0; x < small_.width; ++x, ++to) {
      const int from_x = kStep * x + kOffset;
      copy.z_mm[to] =
          to_mm(z_m[static_cast<std::size_t>(from_y) * width_ + static_cast<std::size_t>(from_x)]);
      copy.colour[to] = colour.at(from_x, from_y);
    }
  }
}

}  // namespace stillmap
