// SPDX-License-Identifier: Apache-2.0
#include "runtime/scene.h"

#include <array>
#include <cmath>

namespace stillmap {

namespace {

constexpr float kGuessedThickness_m = 0.4f;  // of what only its nearer part's depth is known of

/// The mean depth interval of each object's cells.
struct Intervals {
  static constexpr std::uint16_t kNoDepth = 65535;  // how segment marks a cell that has no depth of its own
  struct Sum {
    float near_m = 0, far_m = 0, cells = 0;
  };
  std::array<Sum, decltype(Detections::items)::capacity()> sums{};

  explicit Intervals(const DynamicMask& mask) {
    if (mask.rule != DynamicRule::Silhouette) return;
    const auto cells = static_cast<std::size_t>(mask.columns) * static_cast<std::size_t>(mask.rows);
    for (const DynamicMask::Cell& cell : std::span(mask.cells).first(cells)) {
      if (cell.label == Label::Static || cell.far_mm == 0 || cell.far_mm == kNoDepth) continue;
      Sum& sum = sums[cell.object];
      sum.near_m += 1e-3f * static_cast<float>(cell.near_mm);
      sum.far_m += 1e-3f * static_cast<float>(cell.far_mm);
      ++sum.cells;
    }
  }
};

}  // namespace

void make_scene(const TrackingResult& result, const DynamicMask& mask, std::span<const Feature> features,
                StreamScene& out) {
  out.sequence = result.sequence;
  out.stamp_ns = result.stamp_ns;
  out.has_pose = result.has_pose();
  out.T_map_camera = result.T_map_camera();
  out.objects.clear();
  const Intervals intervals(mask);
  for (std::size_t i = 0; i < mask.boxes.items.size(); ++i) {
    const Detection& d = mask.boxes.items[i];
    if (d.kind != ClassKind::Dynamic && d.kind != ClassKind::SemiStatic) continue;
    StreamObject object{.id = d.object,
                        .class_id = d.class_id,
                        .kind = d.kind,
                        .score = d.score,
                        .box = d.box,
                        .velocity_m_s = result.T_map_odom.R * d.velocity_m_s,
                        .age_ns = d.age_ns};
    const auto& [near_m, far_m, cells] = intervals.sums[i];
    if (cells > 0) {
      object.near_m = near_m / cells;
      object.far_m = far_m / cells;
    } else if (d.depth_m > 0) {
      object.near_m = d.depth_m;
      object.far_m = d.depth_m + kGuessedThickness_m;
    }
    static_cast<void>(out.objects.try_push_back(object));
  }
  out.features.clear();
  for (const Feature& f : features) {
    static_cast<void>(out.features.try_push_back({static_cast<std::uint16_t>(std::lround(f.x)),
                                                  static_cast<std::uint16_t>(std::lround(f.y)), f.label}));
  }
}

}  // namespace stillmap
