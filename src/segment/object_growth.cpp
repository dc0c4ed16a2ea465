// SPDX-License-Identifier: Apache-2.0
#include "segment/object_growth.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

namespace stillmap {

namespace {

/// Arms, a stride, a bent back: an object reaches this far before and behind its bulk.
constexpr int kReachMm = 600;
/// The middle of the box from which the object grows, as a share of the box's width and height.
constexpr double kCore = 0.5;
/// The price of one cell of way where the depth does not change, against long detours.
constexpr int kStepMm = 3;
/// Added to both ends of a cell's depths, beside the noise: the samples do not see each pixel.
constexpr int kMarginMm = 20;
constexpr int kMaxCostMm = std::numeric_limits<std::uint16_t>::max();

}  // namespace

ObjectGrowth::ObjectGrowth(const DepthLayers& grid, const BoxCells& cells, DepthRange main)
    : grid_(grid), cells_(cells) {
  if (main.empty()) {
    for (int row = cells_.box.y0; row < cells_.box.y1; ++row) {
      for (int column = cells_.box.x0; column < cells_.box.x1; ++column)
        hole_[grid_.index(column, row)] = true;
    }
    return;
  }
  cost_mm_.fill(kMaxCostMm);
  seed(main);
  spread();
  take_unreached(main);
  drop_what_goes_on_all_around();
  fill_holes();
}

template <class Use>
void ObjectGrowth::for_each_surface(const CellRect& where, Use use) const {
  for (int row = where.y0; row < where.y1; ++row) {
    for (int column = where.x0; column < where.x1; ++column) {
      for (int i = 0; i < kLayers; ++i) {
        const DepthLayer& layer = grid_.at(column, row)[static_cast<std::size_t>(i)];
        if (layer.samples > 0) use(column, row, node_of(column, row, i), layer);
      }
    }
  }
}

void ObjectGrowth::give(std::size_t node, int cost_mm, Owner owner) {
  if (cost_mm >= cost_mm_[node]) return;
  cost_mm_[node] = static_cast<std::uint16_t>(cost_mm);
  owner_[node] = owner;
  if (queued_[node]) return;
  queued_[node] = true;
  queue_[(queue_begin_ + queue_size_++) % kMaxNodes] = static_cast<std::uint16_t>(node);
}

void ObjectGrowth::seed(DepthRange main) {
  const CellRect& box = cells_.box;
  const double half_w = 0.5 * (box.x1 - box.x0), half_h = 0.5 * (box.y1 - box.y0);
  const DepthRange reach = main.widened(kReachMm);
  for_each_surface(cells_.around, [&](int column, int row, std::size_t node, const DepthLayer& layer) {
    const bool in_core = std::abs(column + 0.5 - box.x0 - half_w) < kCore * half_w &&
                         std::abs(row + 0.5 - box.y0 - half_h) < kCore * half_h;
    if (main.meets(layer)) {
      if (in_core) give(node, 0, Owner::Object);
    } else if (!box.contains(column, row) || !reach.meets(layer)) {
      give(node, 0, Owner::Surroundings);
    }
  });
}

void ObjectGrowth::spread() {
  constexpr std::array<std::array<int, 2>, 4> kSteps{{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};
  while (queue_size_ > 0) {
    const std::size_t node = queue_[queue_begin_];
    queue_begin_ = (queue_begin_ + 1) % kMaxNodes;
    --queue_size_;
    queued_[node] = false;
    const int cell = static_cast<int>(node) / kLayers;
    const int column = cell % grid_.columns(), row = cell / grid_.columns();
    const DepthLayer& here = grid_.at(column, row)[node % kLayers];
    const int gap_mm = grid_.surface_gap_mm(here.far_mm);
    for (const auto& [dx, dy] : kSteps) {
      const int x = column + dx, y = row + dy;
      if (!cells_.around.contains(x, y)) continue;
      for (int i = 0; i < kLayers; ++i) {
        const std::size_t there = node_of(x, y, i);
        if (cost_mm_[there] <= cost_mm_[node] + kStepMm) continue;  // most: the surroundings' own
        const DepthLayer& next = grid_.at(x, y)[static_cast<std::size_t>(i)];
        if (next.samples == 0 || next.near_mm > here.far_mm + gap_mm || next.far_mm < here.near_mm - gap_mm)
          continue;
        const int change_mm = std::abs(next.middle_mm() - here.middle_mm());
        give(there, cost_mm_[node] + change_mm + kStepMm, owner_[node]);
      }
    }
  }
}

/// Parts at the main depth that something in front cuts off from the rest: legs below a table's edge.
void ObjectGrowth::take_unreached(DepthRange main) {
  for_each_surface(cells_.box, [&](int, int, std::size_t node, const DepthLayer& layer) {
    if (owner_[node] == Owner::Nobody && main.meets(layer)) owner_[node] = Owner::Object;
  });
}

/// A head or foot that the box cut off goes on beyond it in one place; a wall or a desk does on all sides,
/// and then the box is all that is known of the object.
void ObjectGrowth::drop_what_goes_on_all_around() {
  int beyond = 0;
  const auto is_beyond = [&](int column, int row, std::size_t node) {
    return owner_[node] == Owner::Object && !cells_.box.contains(column, row);
  };
  for_each_surface(cells_.around, [&](int column, int row, std::size_t node, const DepthLayer&) {
    beyond += is_beyond(column, row, node);
  });
  if (beyond <= (cells_.around.area() - cells_.box.area()) / 2) return;
  for_each_surface(cells_.around, [&](int column, int row, std::size_t node, const DepthLayer&) {
    if (is_beyond(column, row, node)) owner_[node] = Owner::Nobody;
  });
}

/// Cells of the box without a reading that touch the object, directly or through others like them.
void ObjectGrowth::fill_holes() {
  const auto spread_holes_around = [this](int column, int row) {
    for (int y = row - 1; y <= row + 1; ++y) {
      for (int x = column - 1; x <= column + 1; ++x) {
        if (!cells_.box.contains(x, y) || grid_.at(x, y)[0].samples > 0 || hole_[grid_.index(x, y)]) continue;
        hole_[grid_.index(x, y)] = true;
        queue_[queue_size_++] = static_cast<std::uint16_t>(grid_.index(x, y));
      }
    }
  };
  for_each_surface(cells_.around, [&](int column, int row, std::size_t node, const DepthLayer&) {
    if (owner_[node] == Owner::Object) spread_holes_around(column, row);
  });
  for (std::size_t i = 0; i < queue_size_; ++i) {
    const int cell = queue_[i];
    spread_holes_around(cell % grid_.columns(), cell / grid_.columns());
  }
}

DepthRange ObjectGrowth::depths_at(int column, int row) const {
  if (hole_[grid_.index(column, row)]) return {0, std::numeric_limits<std::uint16_t>::max()};
  DepthRange range{std::numeric_limits<int>::max(), -1};
  const auto add = [&](int, int, std::size_t node, const DepthLayer& layer) {
    if (owner_[node] != Owner::Object) return;
    range = {std::min<int>(range.near_mm, layer.near_mm), std::max<int>(range.far_mm, layer.far_mm)};
  };
  for_each_surface({column, row, column + 1, row + 1}, add);
  // The object's outermost pixels lie in cells that the samples gave to what is behind.
  if (range.empty()) {
    for_each_surface({std::max(column - 1, 0), std::max(row - 1, 0), std::min(column + 2, grid_.columns()),
                      std::min(row + 2, grid_.rows())},
                     add);
  }
  return range.empty() ? range : range.widened(kMarginMm + grid_.surface_gap_mm(range.far_mm) / 2);
}

}  // namespace stillmap
