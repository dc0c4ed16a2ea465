// SPDX-License-Identifier: Apache-2.0
#include "detect/yolox_decoder.h"

#include <cmath>

namespace stillmap {

Decoder::Choice YoloxDecoder::choose(std::span<const Tensor> outputs) {
  return choose_flat(outputs, setup_, count_cells(setup_), 5, false);
}

void YoloxDecoder::decode(std::span<const Tensor> chosen, BoxSelection& boxes) const {
  const CellView all = flat_view(chosen[0], false);
  const auto threshold = static_cast<float>(setup_.score_threshold);
  std::size_t first = 0;
  for (const int stride : setup_.strides) {
    const Grid grid = grid_of(setup_, stride);
    const CellView view = all.part(first, grid.cells());
    first += grid.cells();
    const auto found = [&](std::size_t cell, std::uint16_t class_id, float probability) {
      const float score = probability * view.at(cell, 4);
      if (!(score > threshold)) return;
      const auto px = static_cast<float>(stride);
      const float x = (view.at(cell, 0) + static_cast<float>(grid.column(cell))) * px;
      const float y = (view.at(cell, 1) + static_cast<float>(grid.row(cell))) * px;
      const float w = std::exp(view.at(cell, 2)) * px, h = std::exp(view.at(cell, 3)) * px;
      boxes.add({x - w / 2, y - h / 2, x + w / 2, y + h / 2}, class_id, score);
    };
    for_each_best(view.from_channel(5), static_cast<std::size_t>(setup_.classes), threshold, found);
  }
}

}  // namespace stillmap
