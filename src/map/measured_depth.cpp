// SPDX-License-Identifier: Apache-2.0
#include "map/measured_depth.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace stillmap {

namespace {

/// Neighbours whose depth differs by more than 1/20 stand on different surfaces; a neighbour without reading
/// says nothing.
int is_step(int raw, int neighbour) {
  return static_cast<int>(neighbour != 0) & static_cast<int>(20 * std::abs(raw - neighbour) > raw);
}

}  // namespace

MeasuredDepth::MeasuredDepth(Arena& arena, const CameraModel& camera, double max_range_m)
    : camera_(camera),
      max_range_m_(static_cast<float>(max_range_m)),
      z_m_(arena.take<float>("map_measured_depth", static_cast<std::size_t>(camera.width) *
                                                       static_cast<std::size_t>(camera.height))) {}

void MeasuredDepth::prepare(ImageView<const std::uint16_t> depth, const DynamicMask& mask) {
  // The first and last row stay zero, as the arena gave them.
  for (int y = 1; y + 1 < camera_.height; ++y) prepare_row(depth, y);
  if (mask.rule != DynamicRule::Off) leave_out(depth, mask);
}

void MeasuredDepth::prepare_row(ImageView<const std::uint16_t> depth, int y) {
  const std::uint16_t* above = depth.row(y - 1);
  const std::uint16_t* here = depth.row(y);
  const std::uint16_t* below = depth.row(y + 1);
  float* z_m = z_m_.data() + static_cast<std::ptrdiff_t>(y) * camera_.width;
  const float m_per_unit = static_cast<float>(1 / camera_.depth_units_per_m);
  const float min_m = static_cast<float>(camera_.depth_min_m),
              max_m = static_cast<float>(camera_.depth_max_m);
  const float max_range_m = max_range_m_;
  const int last = camera_.width - 1;
  // Without branches, so that the compiler does several pixels at once.
  for (int x = 1; x < last; ++x) {
    const int raw = here[x];
    const float z = static_cast<float>(raw) * m_per_unit;
    const int bad = is_step(raw, here[x - 1]) | is_step(raw, here[x + 1]) | is_step(raw, above[x]) |
                    is_step(raw, below[x]) | static_cast<int>(z < min_m) | static_cast<int>(z > max_m);
    const float signed_z = z > max_range_m ? -z : z;
    z_m[x] = bad != 0 ? 0 : signed_z;
  }
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
