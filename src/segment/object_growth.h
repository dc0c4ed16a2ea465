// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "segment/depth_layers.h"

namespace stillmap {

/// Tells one object's surfaces from its surroundings'. Both grow over the surfaces of the grid at once, the
/// object from the middle of its box, the surroundings from outside it and from depths that the object cannot
/// have; each surface falls to the one that reaches it over the least change in depth. So a person who
/// touches a desk or a wall keeps the feet, and the desk stays the desk's, as no threshold on the depth step
/// alone can do. About 60 KB.
class ObjectGrowth {
 public:
  /// An object whose bulk lies at `main`; an empty `main`, for want of depth, makes the whole box the object.
  ObjectGrowth(const DepthLayers& grid, const BoxCells& cells, DepthRange main);

  /// The object's depths in a cell and the cells around it, widened by the noise; empty where it is not.
  DepthRange depths_at(int column, int row) const;

 private:
  static constexpr int kLayers = DepthLayers::kLayers;
  static constexpr std::size_t kMaxNodes =
      DepthLayers::kMaxCells * kLayers;  // a node is one layer of one cell
  enum class Owner : std::uint8_t { Nobody, Object, Surroundings };

  std::size_t node_of(int column, int row, int layer) const {
    return grid_.index(column, row) * kLayers + static_cast<std::size_t>(layer);
  }
  void seed(DepthRange main);
  void spread();
  void give(std::size_t node, int cost_mm, Owner owner);
  void take_unreached(DepthRange main);
  void drop_what_goes_on_all_around();
  void fill_holes();
  template <class Use>
  void for_each_surface(const CellRect& where, Use use) const;

  const DepthLayers& grid_;
  const BoxCells cells_;
  std::array<Owner, kMaxNodes> owner_{};
  std::array<bool, DepthLayers::kMaxCells> hole_{};  ///< cells without a reading that are the object's
  std::array<std::uint16_t, kMaxNodes> cost_mm_;
  // Nodes whose neighbours are to be looked at, a ring; none is in it twice, so it cannot overflow.
  std::array<std::uint16_t, kMaxNodes> queue_;
  std::array<bool, kMaxNodes> queued_{};
  std::size_t queue_begin_ = 0, queue_size_ = 0;
};

}  // namespace stillmap
