// SPDX-License-Identifier: Apache-2.0
#include "segment/segment.h"

#include <algorithm>
#include <cstddef>
#include <limits>

#include "core/check.h"
#include "segment/depth_layers.h"
#include "segment/main_depth.h"
#include "segment/object_growth.h"

namespace stillmap {

namespace {

// Both live on the stack of a stage's thread, which has 256 KB and masks and frames on it.
static_assert(sizeof(DepthLayers) + sizeof(ObjectGrowth) <= std::size_t{128} << 10);

/// How far an object may stand out of its box, as a share of the box's larger side.
constexpr double kBeyondBox = 0.12;

bool may_move(const Detection& d) {
  return d.kind == ClassKind::Dynamic || d.kind == ClassKind::SemiStatic;
}

BoxCells cells_of(const Box& box, const DepthLayers& grid) {
  return grid.cells_of(box, kBeyondBox * std::max(box.width(), box.height()));
}

/// Puts an object's depths to what other objects left in the cell.
void merge(DepthRange depths, Label label, std::uint8_t object, DynamicMask::Cell& cell) {
  const auto near_mm = static_cast<std::uint16_t>(std::max(depths.near_mm, 0));
  const auto far_mm =
      static_cast<std::uint16_t>(std::min<int>(depths.far_mm, std::numeric_limits<std::uint16_t>::max()));
  if (cell.label == Label::Static || (cell.label == Label::SemiStatic && label == Label::Dynamic)) {
    cell = {near_mm, far_mm, label, object};
  } else if (cell.label == label) {
    if (near_mm < cell.near_mm) cell.object = object;
    cell.near_mm = std::min(cell.near_mm, near_mm);
    cell.far_mm = std::max(cell.far_mm, far_mm);
  }
}

void mark_object(const DepthLayers& grid, std::size_t object, DynamicMask& out) {
  const Detection& item = out.boxes.items[object];
  const BoxCells cells = cells_of(item.box, grid);
  const ObjectGrowth growth(grid, cells, main_depth(grid, cells));
  const Label label = item.kind == ClassKind::Dynamic ? Label::Dynamic : Label::SemiStatic;
  for (int row = cells.around.y0; row < cells.around.y1; ++row) {
    for (int column = cells.around.x0; column < cells.around.x1; ++column) {
      const DepthRange depths = growth.depths_at(column, row);
      if (!depths.empty())
        merge(depths, label, static_cast<std::uint8_t>(object), out.cells[grid.index(column, row)]);
    }
  }
}

void mark_silhouettes(DepthLayers& grid, ImageView<const std::uint16_t> depth, const CameraModel& camera,
                      DynamicMask& out) {
  CellRect needed{grid.columns(), grid.rows(), 0, 0};
  for (const Detection& item : out.boxes.items) {
    if (!may_move(item)) continue;
    const CellRect around = cells_of(item.box, grid).around;
    needed = {std::min(needed.x0, around.x0), std::min(needed.y0, around.y0), std::max(needed.x1, around.x1),
              std::max(needed.y1, around.y1)};
  }
  grid.read(depth, camera, needed);
  for (std::size_t i = 0; i < out.boxes.items.size(); ++i) {
    if (may_move(out.boxes.items[i])) mark_object(grid, i, out);
  }
}

}  // namespace

void segment(const Detections& boxes, ImageView<const std::uint16_t> depth, const CameraModel& camera,
             DynamicRule rule, DynamicMask& out) {
  STILLMAP_CHECK(depth.width == camera.width && depth.height == camera.height);
  DepthLayers grid(camera);
  out.rule = rule;
  out.cell_px = grid.cell_px();
  out.columns = grid.columns();
  out.rows = grid.rows();
  out.cells.fill({});
  out.boxes = boxes;
  if (rule == DynamicRule::Off) out.boxes.items.clear();
  if (rule == DynamicRule::Silhouette) mark_silhouettes(grid, depth, camera, out);
}

}  // namespace stillmap
