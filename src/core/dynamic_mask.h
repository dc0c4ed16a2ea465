// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "core/detection.h"

namespace stillmap {

enum class DynamicRule : std::uint8_t {
  Off,        ///< nothing is rejected: the control
  Paper,      ///< the seed paper's Table 2 over whole boxes: the baseline
  Silhouette  ///< Table 2 with the box split by depth: the default
};

/// What a feature or a pixel is held to be. Unknown: nothing speaks for or against it.
enum class Label : std::uint8_t { Static, Dynamic, SemiStatic, Unknown };

/// Which pixels of one frame belong to things that move. A value: made by `segment`, read by tracker and map.
///
/// Silhouette: the picture is covered by at most 80 x 60 square cells; a cell that meets a moving or
/// semi-static object holds the depth interval of that object, so that a pixel of the same cell behind or
/// before it stays usable. Paper: only the boxes speak, to the pixel.
struct DynamicMask {
  static constexpr int kMaxColumns = 80, kMaxRows = 60;
  struct Cell {
    std::uint16_t near_mm = 0, far_mm = 0;  ///< the object's depth interval, inclusive; far_mm 0: no object
    Label label = Label::Static;            ///< Static (no object), Dynamic or SemiStatic
    std::uint8_t object = 0;  ///< index into `boxes.items`, meaningful where label is not Static
  };

  DynamicRule rule = DynamicRule::Off;
  Detections boxes;  ///< what the mask was made from, on this frame's pixels
  int cell_px = 8, columns = 0, rows = 0;
  std::array<Cell, kMaxColumns * kMaxRows> cells{};

  const Cell& cell_at(double x, double y) const {
    const int column = static_cast<int>(x) / cell_px, row = static_cast<int>(y) / cell_px;
    return cells[static_cast<std::size_t>(row * columns + column)];
  }
};

/// The label of a feature or pixel at (x, y) of the mask's frame, with `depth_m` = 0 for no reading. Any
/// thread.
///
/// Paper: Table 2 to the letter. Dynamic inside a dynamic box and outside every static box; SemiStatic inside
/// a semi-static box and in no other; Static otherwise. Silhouette: the label of the cell where the depth
/// lies in the object's interval; a pixel without depth in such a cell is Unknown.
Label label_at(const DynamicMask& mask, double x, double y, double depth_m);

}  // namespace stillmap
