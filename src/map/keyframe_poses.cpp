// SPDX-License-Identifier: Apache-2.0
#include "map/keyframe_poses.h"

#include <algorithm>

namespace stillmap {

namespace {

constexpr double kLooksAhead_m = 3;  // about where what a camera maps lies

/// How far the camera, or what it sees before it, is taken by a motion.
double displacement_m(const Pose& T_new_old, const Pose& T_old_camera) {
  const auto moved = [&](Vec3 p_camera) {
    const Vec3 p = T_old_camera * p_camera;
    return norm(T_new_old * p - p);
  };
  return std::max(moved({}), moved({0, 0, kLooksAhead_m}));
}

}  // namespace

KeyframePoses::KeyframePoses(Arena& arena)
    : entries_(arena.take<Entry>("map_keyframe_poses", kKept)),
      motions_(arena.take<KeyframeMotions>("map_keyframe_motions", 1)) {}

void KeyframePoses::learn(std::uint32_t id, const Pose& T_map_keyframe) {
  Entry& entry = entries_[id % kKept];
  if (!entry.known || entry.id < id) entry = {true, id, T_map_keyframe};
}

const Pose* KeyframePoses::find(std::uint32_t id) const {
  const Entry& entry = entries_[id % kKept];
  return entry.known && entry.id == id ? &entry.T_map_keyframe : nullptr;
}

bool KeyframePoses::correct(const Correction& correction, double tolerance_m) {
  KeyframeMotions& motions = motions_.front();
  motions.keyframes.clear();
  motions.epoch = correction.epoch;
  motions.segment_begin = correction.segment_begin;
  bool any = false;
  for (const Correction::KeyframePose& keyframe : correction.keyframes) {
    const Pose* before = find(keyframe.id);
    if (before == nullptr) continue;
    Pose T_new_old = keyframe.T_map_camera * inverse(*before);
    T_new_old.R = orthonormalized(T_new_old.R);
    const bool moved = displacement_m(T_new_old, *before) > tolerance_m;
    any |= moved;
    static_cast<void>(motions.keyframes.try_push_back({keyframe.id, moved, moved ? T_new_old : Pose{}}));
  }
  if (!any) {
    motions.keyframes.clear();
    return false;
  }
  std::ranges::sort(motions.keyframes, {}, &KeyframeMotions::Motion::id);
  for (Entry& entry : entries_) {
    if (!entry.known) continue;
    if (const std::optional<Pose> motion = motion_of(entry.id))
      entry.T_map_keyframe = *motion * entry.T_map_keyframe;
  }
  return true;
}

std::optional<Pose> KeyframeMotions::motion_of(std::uint32_t id) const {
  if (keyframes.empty()) return std::nullopt;
  // How a segment lay to the one before was unknown: between the two, nothing moves by halves.
  const Motion* seam = std::ranges::lower_bound(keyframes, segment_begin, {}, &Motion::id);
  const Motion *begin = keyframes.begin(), *end = keyframes.end();
  if (id < segment_begin && seam != begin) end = seam;
  if (id >= segment_begin && seam != end) begin = seam;
  const Motion* after = std::ranges::lower_bound(begin, end, id, {}, &Motion::id);
  if (after == end) --after;
  const Motion* before = after == begin || after->id <= id ? after : after - 1;
  if (!before->moved && !after->moved) return std::nullopt;
  if (before == after) return after->T_new_old;
  const double share = static_cast<double>(id - before->id) / static_cast<double>(after->id - before->id);
  return interpolate(before->T_new_old, after->T_new_old, share);
}

}  // namespace stillmap
