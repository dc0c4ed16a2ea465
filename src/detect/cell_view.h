// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace stillmap {

/// An output seen as cells with channels, whichever of the two lies inside. Does not own.
struct CellView {
  const float* values = nullptr;
  std::size_t cells = 0, cell_step = 1, channel_step = 1;  ///< floats from one to the next

  float at(std::size_t cell, std::size_t channel) const {
    return values[cell * cell_step + channel * channel_step];
  }
  CellView from_channel(std::size_t channel) const {
    return {values + channel * channel_step, cells, cell_step, channel_step};
  }
  CellView part(std::size_t first_cell, std::size_t count) const {
    return {values + first_cell * cell_step, count, cell_step, channel_step};
  }
};

/// Calls `found(cell, class, value)` for every cell whose best of the first `classes` channels is finite and
/// above `threshold`, in order. Channel by channel over blocks of cells, as the memory of a planar output
/// lies.
template <class Found>
void for_each_best(const CellView& view, std::size_t classes, float threshold, const Found& found) {
  constexpr std::size_t kBlock = 160;
  const auto scan = [&](auto cell_step) {
    for (std::size_t first = 0; first < view.cells; first += kBlock) {
      const std::size_t count = std::min(kBlock, view.cells - first);
      std::array<float, kBlock> best;
      std::array<std::uint16_t, kBlock> best_class{};
      best.fill(threshold);
      for (std::size_t id = 0; id < classes; ++id) {
        const float* values = view.values + first * cell_step + id * view.channel_step;
        for (std::size_t i = 0; i < count; ++i) {
          if (values[i * cell_step] > best[i]) {
            best[i] = values[i * cell_step];
            best_class[i] = static_cast<std::uint16_t>(id);
          }
        }
      }
      for (std::size_t i = 0; i < count; ++i) {
        if (best[i] > threshold && std::isfinite(best[i])) found(first + i, best_class[i], best[i]);
      }
    }
  };
  if (view.cell_step == 1) {
    scan(std::integral_constant<std::size_t, 1>());
  } else {
    scan(view.cell_step);
  }
}

}  // namespace stillmap
