// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "core/camera.h"
#include "core/dynamic_mask.h"
#include "core/image.h"

namespace stillmap {

/// A stretch of depth in one cell without a gap: one surface.
struct DepthLayer {
  std::uint16_t near_mm = 0, far_mm = 0;
  std::uint8_t samples = 0;  ///< 0: no surface
  int middle_mm() const { return (near_mm + far_mm) / 2; }
};

/// Whole cells: columns [x0, x1) and rows [y0, y1).
struct CellRect {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool contains(int x, int y) const { return x >= x0 && x < x1 && y >= y0 && y < y1; }
};

/// The depth picture at the resolution of a mask's cells. A cell at an edge sees two surfaces, the object's and what
/// is behind (or before) it, so it keeps its two nearest.
struct DepthLayers {
  static constexpr int kLayers = 2;
  int cell_px = 8, columns = 0, rows = 0;
  std::array<std::array<DepthLayer, kLayers>, DynamicMask::kMaxColumns * DynamicMask::kMaxRows> cells{};

  const std::array<DepthLayer, kLayers>& at(int column, int row) const {
    return cells[static_cast<std::size_t>(row * columns + column)];
  }
};

/// Sizes the grid: the smallest square cells that cover the picture in at most kMaxColumns x kMaxRows.
void set_grid(int width_px, int height_px, DepthLayers& out);

/// Reads the surfaces of the cells of `where`, from at most 16 pixels each.
void read_layers(ImageView<const std::uint16_t> depth, const CameraModel& camera, CellRect where, DepthLayers& out);

/// How far apart two readings of one surface may be: 6 cm and 2 % for relief, and three sigmas of sensor noise.
int surface_gap_mm(const CameraModel& camera, int depth_mm);

}  // namespace stillmap
