// SPDX-License-Identifier: Apache-2.0
#include "segment/segment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/check.h"
#include "segment/depth_layers.h"

namespace stillmap {

namespace {

constexpr int kLayers = DepthLayers::kLayers;
constexpr int kMaxNodes = DynamicMask::kMaxColumns * DynamicMask::kMaxRows * kLayers;
/// How far the object may stand out of its box, as a share of the box's larger side.
constexpr double kBeyondBox = 0.12;
/// Depth of a person or another mover before and behind its main depth: arms and a stride.
constexpr int kReachMm = 600;
/// Beyond the box less is believed: there a floor or a wall touches the object.
constexpr int kReachBeyondMm = 300;
/// Added to both ends of a cell's interval, beside the noise: the samples do not see each pixel.
constexpr int kMarginMm = 50;

/// Depths from 0.2 m in steps of 8 %: about a person's thickness at the range where one fills a picture.
constexpr int kBins = 72;
int bin_of(int depth_mm) {
  const double bin = std::log2(static_cast<float>(std::max(depth_mm, 200)) / 200.0f) * (1 / 0.111);
  return std::min(static_cast<int>(bin), kBins - 1);
}

/// An inclusive depth range; empty where near > far.
struct DepthRange {
  int near_mm = 0, far_mm = -1;
  bool empty() const { return near_mm > far_mm; }
  bool meets(const DepthLayer& layer) const { return layer.near_mm <= far_mm && layer.far_mm >= near_mm; }
};

/// One box at the resolution of the cells.
struct BoxCells {
  CellRect box, around;  ///< the box itself, and with what it may have cut off
};

BoxCells cells_of(const Box& box, const DepthLayers& grid) {
  const auto clipped = [&](double x0, double y0, double x1, double y1) {
    const double px = grid.cell_px;
    return CellRect{static_cast<int>(std::clamp(std::floor(x0 / px), 0.0, static_cast<double>(grid.columns))),
                    static_cast<int>(std::clamp(std::floor(y0 / px), 0.0, static_cast<double>(grid.rows))),
                    static_cast<int>(std::clamp(std::ceil(x1 / px), 0.0, static_cast<double>(grid.columns))),
                    static_cast<int>(std::clamp(std::ceil(y1 / px), 0.0, static_cast<double>(grid.rows)))};
  };
  const double beyond = std::max<double>(grid.cell_px, kBeyondBox * std::max(box.width(), box.height()));
  return {clipped(box.x0, box.y0, box.x1, box.y1),
          clipped(box.x0 - beyond, box.y0 - beyond, box.x1 + beyond, box.y1 + beyond)};
}

/// The range of depths that is the object: the nearest big heap in the box, the middle of it weighing most, less
/// what the surroundings have as well. Empty where the box has next to no depth.
DepthRange main_depth(const DepthLayers& grid, const BoxCells& cells) {
  std::array<float, kBins> inside{}, outside{};
  float inside_sum = 0, outside_sum = 0;
  const CellRect& box = cells.box;
  const float half_w = 0.5f * static_cast<float>(box.x1 - box.x0), half_h = 0.5f * static_cast<float>(box.y1 - box.y0);
  for (int row = cells.around.y0; row < cells.around.y1; ++row) {
    for (int column = cells.around.x0; column < cells.around.x1; ++column) {
      const float u = (static_cast<float>(column - box.x0) + 0.5f) / half_w - 1;
      const float v = (static_cast<float>(row - box.y0) + 0.5f) / half_h - 1;
      const bool in_box = box.contains(column, row);
      const float weight = in_box ? (1 - 0.8f * u * u) * (1 - 0.8f * v * v) : 1;
      for (const DepthLayer& layer : grid.at(column, row)) {
        if (layer.samples == 0) break;
        (in_box ? inside : outside)[static_cast<std::size_t>(bin_of(layer.middle_mm()))] +=
            weight * static_cast<float>(layer.samples);
      }
      (in_box ? inside_sum : outside_sum) += weight * 16;
    }
  }
  // Next to no depth: below 5 % of the readings there could be.
  float readings = 0;
  for (float count : inside) readings += count;
  if (readings < 0.05f * inside_sum) return {};
  std::array<float, kBins> heap{};
  float best = 0, best_plain = 0;
  std::size_t nearest_plain = 1;
  for (std::size_t i = 1; i + 1 < kBins; ++i) {
    const auto share = [i](const std::array<float, kBins>& h, float sum) {
      return sum > 0 ? (h[i - 1] + h[i] + h[i + 1]) / sum : 0;
    };
    const float plain = share(inside, inside_sum);
    heap[i] = plain - share(outside, outside_sum);
    best = std::max(best, heap[i]);
    if (plain > best_plain) {
      best_plain = plain;
      nearest_plain = i;
    }
  }
  std::size_t chosen = nearest_plain;
  if (best > 0.1f) {
    chosen = 1;
    while (heap[chosen] < 0.5f * best) ++chosen;
    while (chosen + 2 < kBins && heap[chosen + 1] > heap[chosen]) ++chosen;
  }
  const auto edge = [](std::size_t bin) { return static_cast<int>(200 * std::exp2(0.111 * static_cast<double>(bin))); };
  return {edge(chosen - 1), edge(chosen + 2)};
}

/// Grows one object over the nodes of the grid.
class ObjectGrowth {
 public:
  ObjectGrowth(const DepthLayers& grid, const CameraModel& camera, const BoxCells& cells)
      : grid_(grid), camera_(camera), cells_(cells) {}

  /// Takes all at the main depth in the box, what hangs together with it there, then the same beyond the box.
  void grow(DepthRange main) {
    for_each_cell(cells_.box, [&](int column, int row) {
      for (int i = 0; i < kLayers; ++i) {
        const DepthLayer& layer = grid_.at(column, row)[static_cast<std::size_t>(i)];
        if (layer.samples > 0 && main.meets(layer)) take(node_of(column, row, i));
      }
    });
    spread(0, cells_.box, {main.near_mm - kReachMm, main.far_mm + kReachMm});
    const int in_box = queued_;
    spread(0, cells_.around, {main.near_mm - kReachBeyondMm, main.far_mm + kReachBeyondMm});
    if (!stands_out(in_box)) drop_from(in_box);
    fill_holes();
  }

  /// The whole box, for want of depth.
  void take_box() {
    for_each_cell(cells_.box, [&](int column, int row) { hole_[cell_of(column, row)] = true; });
  }

  /// The object's depths in the 3x3 cells around, widened by the noise; far_mm 0 where it is not there.
  DynamicMask::Cell cell_around(int column, int row) const {
    if (hole_[cell_of(column, row)]) return {0, std::numeric_limits<std::uint16_t>::max()};
    int near_mm = std::numeric_limits<int>::max(), far_mm = 0;
    for (int y = std::max(row - 1, 0); y < std::min(row + 2, grid_.rows); ++y) {
      for (int x = std::max(column - 1, 0); x < std::min(column + 2, grid_.columns); ++x) {
        for (int i = 0; i < kLayers; ++i) {
          if (!taken_[node_of(x, y, i)]) continue;
          const DepthLayer& layer = grid_.at(x, y)[static_cast<std::size_t>(i)];
          near_mm = std::min<int>(near_mm, layer.near_mm);
          far_mm = std::max<int>(far_mm, layer.far_mm);
        }
      }
    }
    if (far_mm == 0) return {};
    const int margin = kMarginMm + surface_gap_mm(camera_, far_mm) / 2;
    return {static_cast<std::uint16_t>(std::max(near_mm - margin, 0)),
            static_cast<std::uint16_t>(std::min(far_mm + margin, 65535))};
  }

 private:
  template <class Use>
  static void for_each_cell(const CellRect& rect, Use use) {
    for (int row = rect.y0; row < rect.y1; ++row) {
      for (int column = rect.x0; column < rect.x1; ++column) use(column, row);
    }
  }
  std::size_t cell_of(int column, int row) const { return static_cast<std::size_t>(row * grid_.columns + column); }
  std::size_t node_of(int column, int row, int layer) const {
    return cell_of(column, row) * kLayers + static_cast<std::size_t>(layer);
  }
  void take(std::size_t node) {
    taken_[node] = true;
    queue_[static_cast<std::size_t>(queued_++)] = static_cast<std::uint16_t>(node);
  }

  /// From the queue's nodes since `from` to their 4 neighbours of the same surface within `bounds` and `range`.
  void spread(int from, const CellRect& bounds, DepthRange range) {
    constexpr std::array<std::array<int, 2>, 4> kSteps{{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};
    for (int i = from; i < queued_; ++i) {
      const int node = queue_[static_cast<std::size_t>(i)], cell = node / kLayers;
      const int column = cell % grid_.columns, row = cell / grid_.columns;
      const DepthLayer& layer = grid_.at(column, row)[static_cast<std::size_t>(node % kLayers)];
      const int gap = surface_gap_mm(camera_, layer.far_mm);
      for (const auto& [dx, dy] : kSteps) {
        if (!bounds.contains(column + dx, row + dy)) continue;
        for (int k = 0; k < kLayers; ++k) {
          const DepthLayer& next = grid_.at(column + dx, row + dy)[static_cast<std::size_t>(k)];
          const std::size_t next_node = node_of(column + dx, row + dy, k);
          if (next.samples == 0 || taken_[next_node] || !range.meets(next)) continue;
          if (next.near_mm <= layer.far_mm + gap && next.far_mm >= layer.near_mm - gap) take(next_node);
        }
      }
    }
  }

  /// Whether the growth beyond the box is an object's rather than the floor's or the desk's that goes on all around.
  bool stands_out(int in_box) const {
    const auto area = [](const CellRect& r) { return (r.x1 - r.x0) * (r.y1 - r.y0); };
    return queued_ - in_box <= (area(cells_.around) - area(cells_.box)) / 2;
  }
  void drop_from(int first) {
    for (int i = first; i < queued_; ++i) taken_[queue_[static_cast<std::size_t>(i)]] = false;
    queued_ = first;
  }

  /// Cells of the box without a reading that touch the object, directly or through others such.
  void fill_holes() {
    const auto is_hole = [&](int column, int row) {
      return cells_.box.contains(column, row) && grid_.at(column, row)[0].samples == 0;
    };
    for (int i = 0; i < queued_; ++i) {
      // Nodes in the queue are surfaces first, then the holes found, numbered as their cell's first layer.
      const int cell = queue_[static_cast<std::size_t>(i)] / kLayers;
      const int column = cell % grid_.columns, row = cell / grid_.columns;
      for (int y = row - 1; y <= row + 1; ++y) {
        for (int x = column - 1; x <= column + 1; ++x) {
          if (!is_hole(x, y) || hole_[cell_of(x, y)]) continue;
          hole_[cell_of(x, y)] = true;
          queue_[static_cast<std::size_t>(queued_++)] = static_cast<std::uint16_t>(node_of(x, y, 0));
        }
      }
    }
  }

  const DepthLayers& grid_;
  const CameraModel& camera_;
  const BoxCells& cells_;
  std::array<bool, kMaxNodes> taken_{};
  std::array<bool, DynamicMask::kMaxColumns * DynamicMask::kMaxRows> hole_{};
  std::array<std::uint16_t, kMaxNodes> queue_;
  int queued_ = 0;
};

/// Puts an object's cell to what other objects left there.
void merge(const DynamicMask::Cell& found, Label label, std::uint8_t object, DynamicMask::Cell& cell) {
  if (cell.label == Label::Static || (cell.label == Label::SemiStatic && label == Label::Dynamic)) {
    cell = {found.near_mm, found.far_mm, label, object};
  } else if (cell.label == label) {
    if (found.near_mm < cell.near_mm) cell.object = object;
    cell.near_mm = std::min(cell.near_mm, found.near_mm);
    cell.far_mm = std::max(cell.far_mm, found.far_mm);
  }
}

void mark_silhouettes(ImageView<const std::uint16_t> depth, const CameraModel& camera, const DepthLayers& empty_grid,
                      DynamicMask& out) {
  DepthLayers grid = empty_grid;
  for (std::size_t i = 0; i < out.boxes.items.size(); ++i) {
    const Detection& item = out.boxes.items[i];
    if (item.kind != ClassKind::Dynamic && item.kind != ClassKind::SemiStatic) continue;
    const BoxCells cells = cells_of(item.box, grid);
    read_layers(depth, camera, cells.around, grid);
    ObjectGrowth growth(grid, camera, cells);
    if (const DepthRange main = main_depth(grid, cells); main.empty()) {
      growth.take_box();
    } else {
      growth.grow(main);
    }
    const Label label = item.kind == ClassKind::Dynamic ? Label::Dynamic : Label::SemiStatic;
    for (int row = cells.around.y0; row < cells.around.y1; ++row) {
      for (int column = cells.around.x0; column < cells.around.x1; ++column) {
        const DynamicMask::Cell found = growth.cell_around(column, row);
        auto& cell = out.cells[static_cast<std::size_t>(row * out.columns + column)];
        if (found.far_mm > 0) merge(found, label, static_cast<std::uint8_t>(i), cell);
      }
    }
  }
}

}  // namespace

void segment(const Detections& boxes, ImageView<const std::uint16_t> depth, const CameraModel& camera,
             DynamicRule rule, DynamicMask& out) {
  STILLMAP_CHECK(depth.width == camera.width && depth.height == camera.height);
  DepthLayers grid;
  set_grid(camera.width, camera.height, grid);
  out.rule = rule;
  out.cell_px = grid.cell_px;
  out.columns = grid.columns;
  out.rows = grid.rows;
  out.cells.fill({});
  out.boxes = boxes;
  if (rule == DynamicRule::Off) out.boxes.items.clear();
  if (rule == DynamicRule::Silhouette) mark_silhouettes(depth, camera, grid, out);
}

}  // namespace stillmap
