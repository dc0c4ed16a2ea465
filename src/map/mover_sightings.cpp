// SPDX-License-Identifier: Apache-2.0
#include "map/mover_sightings.h"

#include <algorithm>

namespace stillmap {

namespace {

bool has_place(const Detection& box) {
  return box.kind == ClassKind::Dynamic && box.depth_m > 0;
}

}  // namespace

bool MoverSightings::filter(Detections& boxes, const Pose& T_map_camera) {
  note(boxes, T_map_camera);
  const auto kept = std::remove_if(boxes.items.begin(), boxes.items.end(), [&](const Detection& box) {
    return has_place(box) && box.score < sure_score_ && !counts(box, boxes.stamp_ns, T_map_camera);
  });
  const bool removed = kept != boxes.items.end();
  boxes.items.truncate(static_cast<std::size_t>(kept - boxes.items.begin()));
  return removed;
}

void MoverSightings::note(const Detections& boxes, const Pose& T_map_camera) {
  for (const Detection& box : boxes.items) {
    if (!has_place(box)) continue;
    sightings_[static_cast<std::size_t>(noted_++ % sightings_.size())] = {
        boxes.stamp_ns, place_of(box, T_map_camera), box.score >= sure_score_};
  }
}

bool MoverSightings::counts(const Detection& box, Nanoseconds stamp_ns, const Pose& T_map_camera) const {
  const Vec3 p_map = place_of(box, T_map_camera);
  const auto end =
      sightings_.begin() + static_cast<std::ptrdiff_t>(std::min<std::uint64_t>(noted_, sightings_.size()));
  return std::any_of(sightings_.begin(), end, [&](const Sighting& there) {
    const double age_s = to_seconds(stamp_ns - there.stamp_ns);
    return age_s <= kKept_s && (there.sure || age_s >= kRipe_s) && norm(there.p_map - p_map) < kReach_m;
  });
}

Vec3 MoverSightings::place_of(const Detection& box, const Pose& T_map_camera) const {
  const double x = (box.box.x0 + box.box.x1) / 2.0, y = (box.box.y0 + box.box.y1) / 2.0;
  return T_map_camera * (static_cast<double>(box.depth_m) *
                         Vec3{(x - camera_.cx) / camera_.fx, (y - camera_.cy) / camera_.fy, 1});
}

}  // namespace stillmap
