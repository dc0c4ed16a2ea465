// SPDX-License-Identifier: Apache-2.0
#include "map/measured_depth.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace stillmap {

namespace {

/// How a reading relates to its four neighbours.
struct Edge {
  int nearest;  ///< the least of them that there is
  int is_step;  ///< 1 where one differs by more than 1/20: it stands on another surface
};

/// Without branches, so that the compiler does several pixels at once. A neighbour without reading says
/// nothing.
Edge edge_at(int raw, int left, int right, int above, int below) {
  Edge edge{raw, 0};
  for (const int neighbour : {left, right, above, below}) {
    const int there = neighbour != 0 ? neighbour : raw;
    edge.nearest = there < edge.nearest ? there : edge.nearest;
    edge.is_step |= static_cast<int>(20 * std::abs(raw - there) > raw);
  }
  return edge;
}

}  // namespace

MeasuredDepth::MeasuredDepth(Arena& arena, const CameraModel& camera, double max_range_m)
    : camera_(camera),
      max_range_m_(static_cast<float>(max_range_m)),
      z_m_(arena.take<float>("map_measured_depth", static_cast<std::size_t>(camera.width) *
                                                       static_cast<std::size_t>(camera.height))) {}

void MeasuredDepth::prepare(ImageView<const std::uint16_t> depth, const DynamicMask& mask) {
  for (int y = 0; y < camera_.height; ++y) prepare_row(depth, y);
  if (mask.rule != DynamicRule::Off) leave_out(depth, mask);
}

void MeasuredDepth::prepare_row(ImageView<const std::uint16_t> depth, int y) {
  const std::uint16_t* above = depth.row(std::max(y - 1, 0));
  const std::uint16_t* here = depth.row(y);
  const std::uint16_t* below = depth.row(std::min(y + 1, camera_.height - 1));
  float* z_m = z_m_.data() + static_cast<std::ptrdiff_t>(y) * camera_.width;
  const float m_per_unit = static_cast<float>(1 / camera_.depth_units_per_m);
  const float min_m = static_cast<float>(camera_.depth_min_m),
              max_m = static_cast<float>(camera_.depth_max_m);
  const float max_range_m = max_range_m_;
  const int last = camera_.width - 1;
  const auto measure = [=](int x, int left, int right) {
    const Edge edge = edge_at(here[x], here[left], here[right], above[x], below[x]);
    const float z = static_cast<float>(here[x]) * m_per_unit,
                near = static_cast<float>(edge.nearest) * m_per_unit;
    const int trusted = static_cast<int>(z >= min_m) & static_cast<int>(z <= max_m);
    const int mapped = static_cast<int>(z <= max_range_m) & (1 - edge.is_step);
    const float signed_z = mapped != 0 ? z : -near;
    z_m[x] = trusted != 0 ? signed_z : 0;
  };
  measure(0, 0, 1);
  for (int x = 1; x < last; ++x) measure(x, x - 1, x + 1);
  measure(last, last - 1, last);
}

void MeasuredDepth::leave_out(ImageView<const std::uint16_t> depth, const DynamicMask& mask) {
  if (mask.rule == DynamicRule::Paper) {
    for (const Detection& d : mask.boxes.items) {
      if (d.kind == ClassKind::Dynamic) leave_out_in(d.box, depth, mask);
    }
    return;
  }
  for (int row = 0; row < mask.rows; ++row) {
    for (int column = 0; column < mask.columns; ++column) {
      if (mask.cells[static_cast<std::size_t>(row * mask.columns + column)].label != Label::Dynamic) continue;
      const float x = static_cast<float>(column * mask.cell_px), y = static_cast<float>(row * mask.cell_px);
      const float edge = static_cast<float>(mask.cell_px);
      leave_out_in({x, y, x + edge, y + edge}, depth, mask);
    }
  }
}

void MeasuredDepth::leave_out_in(const Box& region, ImageView<const std::uint16_t> depth,
                                 const DynamicMask& mask) {
  if (!(region.width() > 0 && region.height() > 0)) return;  // a NaN comes out here, too
  const float w = static_cast<float>(camera_.width), h = static_cast<float>(camera_.height);
  const int x0 = static_cast<int>(std::clamp(std::floor(region.x0), 0.0f, w));
  const int x1 = static_cast<int>(std::clamp(std::ceil(region.x1), 0.0f, w));
  const int y0 = static_cast<int>(std::clamp(std::floor(region.y0), 0.0f, h));
  const int y1 = static_cast<int>(std::clamp(std::ceil(region.y1), 0.0f, h));
  for (int y = y0; y < y1; ++y) {
    float* z_m = z_m_.data() + static_cast<std::ptrdiff_t>(y) * camera_.width;
    for (int x = x0; x < x1; ++x) {
      if (z_m[x] > 0 && left_out_of_map(mask, x, y, camera_.depth_m(depth.at(x, y)))) z_m[x] = -z_m[x];
    }
  }
}

}  // namespace stillmap
