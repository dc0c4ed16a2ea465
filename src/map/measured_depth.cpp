// SPDX-License-Identifier: Apache-2.0
#include "map/measured_depth.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace stillmap {

namespace {

/// How a reading relates to its four neighbours.
struct Edge {
  std::uint16_t nearest;  ///< the least of them that there is
  std::uint16_t is_step;  ///< 1 where one differs by more than 1/20: it stands on another surface
};

/// Without branches and in 16 bits, so that the compiler does eight pixels at once. A neighbour without
/// reading says nothing.
Edge edge_at(std::uint16_t raw, std::uint16_t left, std::uint16_t right, std::uint16_t above,
             std::uint16_t below) {
  const std::uint16_t most = raw / 20;
  Edge edge{raw, 0};
  const auto compare = [&](std::uint16_t neighbour) {
    const auto there = static_cast<std::uint16_t>(neighbour | (raw & -static_cast<int>(neighbour == 0)));
    const std::uint16_t near = there < raw ? there : raw, far = there < raw ? raw : there;
    edge.nearest = there < edge.nearest ? there : edge.nearest;
    edge.is_step |= static_cast<std::uint16_t>(far - near) > most ? 1 : 0;
  };
  compare(left);
  compare(right);
  compare(above);
  compare(below);
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
      if (d.kind == ClassKind::Dynamic) leave_out_in(d.box, Readings{}, depth);
    }
    return;
  }
  for (int row = 0; row < mask.rows; ++row) {
    for (int column = 0; column < mask.columns; ++column) {
      const DynamicMask::Cell& cell = mask.cells[static_cast<std::size_t>(row * mask.columns + column)];
      if (cell.label != Label::Dynamic) continue;
      const float x = static_cast<float>(column * mask.cell_px), y = static_cast<float>(row * mask.cell_px);
      const float edge = static_cast<float>(mask.cell_px);
      leave_out_in({x, y, x + edge, y + edge}, readings_of(cell), depth);
    }
  }
}

MeasuredDepth::Readings MeasuredDepth::readings_of(const DynamicMask::Cell& cell) const {
  const double per_mm = camera_.depth_units_per_m / 1000;
  const auto mm = [this](int raw) { return raw / camera_.depth_units_per_m * 1000; };
  Readings readings{static_cast<int>(cell.near_mm * per_mm) - 1, static_cast<int>(cell.far_mm * per_mm) + 1};
  while (mm(readings.first) < cell.near_mm) ++readings.first;
  while (mm(readings.last) > cell.far_mm) --readings.last;
  return readings;
}

void MeasuredDepth::leave_out_in(const Box& region, Readings readings, ImageView<const std::uint16_t> depth) {
  if (!(region.width() > 0 && region.height() > 0)) return;  // a NaN comes out here, too
  const auto within = [](float at, int size) {
    return static_cast<int>(std::clamp(std::ceil(at), 0.0f, static_cast<float>(size)));
  };
  const int x0 = within(region.x0, camera_.width), x1 = within(region.x1, camera_.width);
  const int y1 = within(region.y1, camera_.height);
  for (int y = within(region.y0, camera_.height); y < y1; ++y) {
    float* z_m = z_m_.data() + static_cast<std::ptrdiff_t>(y) * camera_.width;
    const std::uint16_t* raw = depth.row(y);
    for (int x = x0; x < x1; ++x) {
      const int out = static_cast<int>(raw[x] >= readings.first) & static_cast<int>(raw[x] <= readings.last);
      z_m[x] = out != 0 ? -std::abs(z_m[x]) : z_m[x];
    }
  }
}

}  // namespace stillmap
