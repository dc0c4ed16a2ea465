// SPDX-License-Identifier: Apache-2.0
#include "detect/yolo_decoder.h"

#include <cmath>

namespace stillmap {

namespace {

constexpr std::size_t kAnchors = 3;  // YOLOv5's, for each cell

}  // namespace

Decoder::Choice YoloDecoder::choose(std::span<const Tensor> outputs) {
  const std::size_t cells = count_cells(setup_);
  if (version_ == Version::V8) return choose_flat(outputs, setup_, cells, 4, true);
  return choose_flat(outputs, setup_, version_ == Version::V5 ? kAnchors * cells : cells, 5, false);
}

void YoloDecoder::decode(std::span<const Tensor> chosen, BoxSelection& boxes) const {
  const CellView all = flat_view(chosen[0], version_ == Version::V8);
  if (version_ != Version::X) return decode_cells(all, {}, boxes);
  std::size_t first = 0;
  for (const int stride : setup_.strides) {
    const Grid grid = grid_of(setup_, stride);
    decode_cells(all.part(first, grid.cells()), grid, boxes);
    first += grid.cells();
  }
}

/// Numbers are in strides of `grid`; in px of the input where its stride is 0.
void YoloDecoder::decode_cells(const CellView& view, const Grid& grid, BoxSelection& boxes) const {
  const bool has_object = version_ != Version::V8;
  const auto threshold = static_cast<float>(setup_.score_threshold);
  const auto found = [&](std::size_t cell, std::uint16_t class_id, float probability) {
    // A probability of at most one times another: what is below the threshold alone stays there.
    const float score = has_object ? probability * view.at(cell, 4) : probability;
    if (!(score > threshold)) return;
    float x = view.at(cell, 0), y = view.at(cell, 1), w = view.at(cell, 2), h = view.at(cell, 3);
    if (grid.stride_px > 0) {
      const auto px = static_cast<float>(grid.stride_px);
      x = (x + static_cast<float>(grid.column(cell))) * px;
      y = (y + static_cast<float>(grid.row(cell))) * px;
      w = std::exp(w) * px;
      h = std::exp(h) * px;
    }
    boxes.add({x - w / 2, y - h / 2, x + w / 2, y + h / 2}, class_id, score);
  };
  for_each_best(view.from_channel(has_object ? 5 : 4), static_cast<std::size_t>(setup_.classes), threshold,
                found);
}

}  // namespace stillmap
