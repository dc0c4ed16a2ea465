// SPDX-License-Identifier: Apache-2.0
#include "map/mover_trail.h"

#include <algorithm>
#include <cmath>

namespace stillmap {

MoverTrail::MoverTrail(Arena& arena, const CameraModel& camera, const RayTable& rays)
    : camera_(camera), rays_(rays), buckets_(arena.take<Bucket>("map_mover_trail", kBuckets)) {}

MoverTrail::Cell MoverTrail::cell_of(Vec3 p_map) const {
  const auto cell = [](double m) { return static_cast<std::int32_t>(std::floor(m / kCell_m)); };
  return {cell(p_map.x), cell(p_map.y), cell(p_map.z)};
}

std::size_t MoverTrail::bucket_of(const Cell& cell) {
  const std::uint64_t mixed = static_cast<std::uint32_t>(cell.x) * 0x9e3779b97f4a7c15u ^
                              static_cast<std::uint32_t>(cell.y) * 0xc2b2ae3d27d4eb4fu ^
                              static_cast<std::uint32_t>(cell.z) * 0x165667b19e3779f9u;
  return static_cast<std::size_t>((mixed ^ mixed >> 32) * 0x9e3779b97f4a7c15u >> 32) % kBuckets;
}

void MoverTrail::add_frame(ImageView<const std::uint16_t> depth, const DynamicMask& mask, float sure_score,
                           const Pose& T_map_camera_depth, double max_range_m) {
  ++frame_;
  if (mask.rule != DynamicRule::Silhouette) return;
  for (int row = 0; row < mask.rows; ++row) {
    for (int column = 0; column < mask.columns; ++column) {
      const DynamicMask::Cell& cell = mask.cells[static_cast<std::size_t>(row * mask.columns + column)];
      if (cell.label != Label::Dynamic) continue;
      const int x = std::min(column * mask.cell_px + mask.cell_px / 2, camera_.width - 1);
      const int y = std::min(row * mask.cell_px + mask.cell_px / 2, camera_.height - 1);
      const double z_m = camera_.depth_m(depth.at(x, y)), z_mm = 1000 * z_m;
      if (z_m <= 0 || z_m > max_range_m || z_mm < cell.near_mm || z_mm > cell.far_mm) continue;
      const RayTable::Ray ray = rays_.at(x, y);
      mark_around(cell_of(T_map_camera_depth * Vec3{ray.x * z_m, ray.y * z_m, z_m}),
                  mask.boxes.items[cell.object].score >= sure_score ? &Cell::sure : &Cell::unsure);
    }
  }
}

void MoverTrail::mark_around(const Cell& middle, Mark Cell::*which) {
  constexpr int kReach = static_cast<int>(kReach_m / kCell_m);
  Mark& there = marked(middle, which);
  if (there.middle_frame == frame_) return;
  there.middle_frame = frame_;
  last_marked_frame_ = frame_;
  for (int z = -kReach; z <= kReach; ++z) {
    for (int y = -kReach; y <= kReach; ++y) {
      for (int x = -kReach; x <= kReach; ++x) {
        if (x * x + y * y + z * z <= kReach * kReach)
          marked({middle.x + x, middle.y + y, middle.z + z}, which);
      }
    }
  }
}

MoverTrail::Mark& MoverTrail::marked(const Cell& cell, Mark Cell::*which) {
  Bucket& bucket = buckets_[bucket_of(cell)];
  auto there = std::ranges::find_if(bucket, [&](const Cell& other) { return other.same_place(cell); });
  if (there == bucket.end()) {
    there = std::ranges::max_element(bucket, {}, [&](const Cell& other) { return age(other); });
    *there = cell;
  }
  Mark& mark = *there.*which;
  mark.frame = frame_;
  return mark;
}

MoverTrail::Nearness MoverTrail::near(Vec3 p_map) const {
  if (age(last_marked_frame_) > kFrames) return Nearness::None;
  const Cell cell = cell_of(p_map);
  const Bucket& bucket = buckets_[bucket_of(cell)];
  const auto there = std::ranges::find_if(bucket, [&](const Cell& other) { return other.same_place(cell); });
  if (there == bucket.end() || age(*there) > kFrames) return Nearness::None;
  return age(there->sure.frame) <= kFrames ? Nearness::Sure : Nearness::Unsure;
}

}  // namespace stillmap
