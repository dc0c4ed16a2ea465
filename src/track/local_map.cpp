// SPDX-License-Identifier: Apache-2.0
#include "track/local_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace stillmap {

namespace {

/// Between two views: a metre weighs as much as a radian (of the chord: this is asked for each pair).
double distance(const Pose& a, const Pose& b) {
  double trace = 0;  // of Ra^T Rb
  for (std::size_t i = 0; i < 9; ++i) trace += a.R.m[i] * b.R.m[i];
  return norm(a.t - b.t) + std::sqrt(std::max(0.0, 3 - trace));
}

}  // namespace

LocalMap::LocalMap(Arena& arena, std::size_t keyframes, std::size_t points)
    : points_(arena.take<MapPoint>("map_points", points)),
      free_points_(arena.take<std::uint32_t>("map_points.free", points)),
      by_age_(arena.take<std::uint32_t>("map_points.by_age", points)),
      keyframes_(arena.take<Keyframe>("keyframes", keyframes)) {
  clear();
}

void LocalMap::clear() {
  free_count_ = points_.size();
  for (std::size_t i = 0; i < points_.size(); ++i) {
    points_[i].alive = false;
    free_points_[i] = static_cast<std::uint32_t>(points_.size() - 1 - i);
  }
  for (Keyframe& k : keyframes_) k.alive = false;
}

/// Points that were found longest ago say least about where the camera is now. Some are given up at once:
/// a keyframe brings hundreds, and to look through all points for each would take milliseconds.
void LocalMap::give_up_points() {
  constexpr std::size_t kShare = 64;
  const std::size_t count = std::max<std::size_t>(1, points_.size() / kShare);
  std::iota(by_age_.begin(), by_age_.end(), 0u);
  const auto age = [&](std::uint32_t i) { return std::pair(points_[i].last_found_sequence, i); };
  const auto end = by_age_.begin() + static_cast<std::ptrdiff_t>(count);
  std::nth_element(by_age_.begin(), end - 1, by_age_.end(),
                   [&](std::uint32_t i, std::uint32_t j) { return age(i) < age(j); });
  for (auto slot = by_age_.begin(); slot != end; ++slot) remove_point(*slot);
  points_refused_ += count;
}

PointRef LocalMap::add_point(const MapPoint& point) {
  if (free_count_ == 0) give_up_points();
  const std::size_t slot = free_points_[--free_count_];
  points_[slot] = point;
  points_[slot].alive = true;
  points_[slot].id = next_point_id_;
  points_[slot].segment = segment_;
  next_point_id_ = std::max(next_point_id_ + 1, std::uint32_t{1});
  points_high_water_ = std::max<std::uint64_t>(points_high_water_, points_.size() - free_count_);
  return {static_cast<std::int32_t>(slot), points_[slot].id};
}

void LocalMap::remove_point(std::size_t slot) {
  STILLMAP_CHECK(points_[slot].alive);
  points_[slot].alive = false;
  free_points_[free_count_++] = static_cast<std::uint32_t>(slot);
}

MapPoint* LocalMap::find(PointRef ref) {
  if (ref.slot < 0) return nullptr;
  MapPoint& point = points_[static_cast<std::size_t>(ref.slot)];
  return point.alive && point.id == ref.id ? &point : nullptr;
}

void LocalMap::join_segments(std::uint32_t segment, std::uint32_t other) {
  const auto join = [&](std::uint32_t& s) { s = s == other ? segment : s; };
  for (MapPoint& point : points_) join(point.segment);
  for (Keyframe& keyframe : keyframes_) join(keyframe.segment);
  join(segment_);
}

std::size_t LocalMap::keyframe_to_reuse() const {
  // The one whose view its neighbours repeat best: nearest to another keyframe in place and direction. The
  // newest three are what tracking stands on and stay.
  const auto newest = std::max_element(keyframes_.begin(), keyframes_.end(),
                                       [](const Keyframe& a, const Keyframe& b) { return a.id < b.id; });
  double smallest = std::numeric_limits<double>::max();
  std::size_t chosen = 0;
  for (std::size_t i = 0; i < keyframes_.size(); ++i) {
    if (keyframes_[i].id + 3 > newest->id) continue;
    for (std::size_t j = 0; j < keyframes_.size(); ++j) {
      if (i == j || keyframes_[i].segment != keyframes_[j].segment) continue;
      const double apart = distance(keyframes_[i].T_odom_camera, keyframes_[j].T_odom_camera);
      if (apart < smallest) {
        smallest = apart;
        chosen = i;
      }
    }
  }
  return chosen;
}

Keyframe& LocalMap::add_keyframe() {
  auto free = std::find_if(keyframes_.begin(), keyframes_.end(), [](const Keyframe& k) { return !k.alive; });
  if (free == keyframes_.end()) {
    ++keyframes_evicted_;
    free = keyframes_.begin() + static_cast<std::ptrdiff_t>(keyframe_to_reuse());
  }
  free->alive = true;
  free->id = next_keyframe_id_++;
  free->segment = segment_;
  free->features.clear();
  const auto used =
      std::count_if(keyframes_.begin(), keyframes_.end(), [](const Keyframe& k) { return k.alive; });
  keyframes_high_water_ = std::max(keyframes_high_water_, static_cast<std::uint64_t>(used));
  return *free;
}

const Keyframe* LocalMap::find_keyframe(std::uint32_t id) const {
  const auto found = std::find_if(keyframes_.begin(), keyframes_.end(),
                                  [id](const Keyframe& k) { return k.alive && k.id == id; });
  return found == keyframes_.end() ? nullptr : &*found;
}

Keyframe* LocalMap::newest_keyframe() {
  Keyframe* newest = nullptr;
  for (Keyframe& k : keyframes_) {
    if (k.alive && (newest == nullptr || k.id > newest->id)) newest = &k;
  }
  return newest;
}

}  // namespace stillmap
