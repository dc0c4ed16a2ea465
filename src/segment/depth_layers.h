// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/camera.h"
#include "core/dynamic_mask.h"
#include "core/image.h"

namespace stillmap {

/// A stretch of depth in one cell without a gap: one surface.
struct DepthLayer {
  std::uint16_t near_mm = 0, far_mm = 0;  ///< inclusive
  std::uint16_t samples = 0;              ///< 0: no surface
  int middle_mm() const { return (near_mm + far_mm) / 2; }
};

/// An inclusive depth range; empty where near > far.
struct DepthRange {
  int near_mm = 0, far_mm = -1;
  bool empty() const { return near_mm > far_mm; }
  bool meets(const DepthLayer& layer) const { return layer.near_mm <= far_mm && layer.far_mm >= near_mm; }
  DepthRange widened(int mm) const { return {near_mm - mm, far_mm + mm}; }
};

/// Whole cells: columns [x0, x1) and rows [y0, y1).
struct CellRect {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool contains(int x, int y) const { return x >= x0 && x < x1 && y >= y0 && y < y1; }
  int area() const { return (x1 - x0) * (y1 - y0); }
};

/// A detection's box at the resolution of the cells, clipped to the picture.
struct BoxCells {
  CellRect box,
      around;  ///< the box; the box with what it may have cut off and the surroundings to compare it with
};

/// The depth picture at the resolution of a mask's cells. A cell at an edge sees two surfaces, the object's
/// and what is behind or before it, so each cell keeps its two nearest. About 60 KB.
class DepthLayers {
 public:
  static constexpr int kLayers = 2;
  static constexpr std::size_t kMaxCells = DynamicMask::kMaxColumns * DynamicMask::kMaxRows;
  /// The two surfaces of a cell, the nearer one first.
  using Cell = std::array<DepthLayer, kLayers>;

  /// The smallest square cells that cover the camera's picture in at most kMaxColumns x kMaxRows.
  explicit DepthLayers(const CameraModel& camera);

  int cell_px() const { return cell_px_; }
  int columns() const { return columns_; }
  int rows() const { return rows_; }

  /// Reads the surfaces of the cells of `where`, from at most 16 pixels each.
  void read(ImageView<const std::uint16_t> depth, const CameraModel& camera, CellRect where);

  std::size_t index(int column, int row) const { return static_cast<std::size_t>(row * columns_ + column); }
  const Cell& at(int column, int row) const { return cells_[index(column, row)]; }
  /// How far apart two readings of one surface may be: 3 cm and 1 % for relief, and three sigmas of sensor
  /// noise.
  int surface_gap_mm(int depth_mm) const { return gaps_mm_[static_cast<std::size_t>(depth_mm / kGapStepMm)]; }

  /// `beyond` px more on each side, at least one cell, make the surroundings.
  BoxCells cells_of(const Box& box, double beyond_px) const;

 private:
  static constexpr int kGapStepMm = 64;
  int cell_px_ = 1, columns_ = 0, rows_ = 0;
  std::array<std::uint16_t, 65536 / kGapStepMm> gaps_mm_{};
  std::array<Cell, kMaxCells> cells_{};
};

}  // namespace stillmap
