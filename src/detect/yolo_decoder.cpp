// SPDX-License-Identifier: Apache-2.0
#include "detect/yolo_decoder.h"

namespace stillmap {

namespace {

constexpr std::size_t kAnchors = 3;  // YOLOv5's, for each cell

}  // namespace

Decoder::Choice YoloDecoder::choose(std::span<const Tensor> outputs) {
  const std::size_t cells = count_cells(setup_);
  if (version_ == Version::V8) return choose_flat(outputs, setup_, cells, 4, true);
  return choose_flat(outputs, setup_, kAnchors * cells, 5, false);
}

void YoloDecoder::decode(std::span<const Tensor> chosen, BoxSelection& boxes) const {
  const bool has_object = version_ == Version::V5;
  const CellView view = flat_view(chosen[0], !has_object);
  const auto threshold = static_cast<float>(setup_.score_threshold);
  // A probability of at most one times another: what is below the threshold alone stays there.
  for_each_best(view.from_channel(has_object ? 5 : 4), static_cast<std::size_t>(setup_.classes), threshold,
                [&](std::size_t cell, std::uint16_t class_id, float probability) {
                  const float score = has_object ? probability * view.at(cell, 4) : probability;
                  if (!(score > threshold)) return;
                  const float x = view.at(cell, 0), y = view.at(cell, 1);
                  const float w = view.at(cell, 2), h = view.at(cell, 3);
                  boxes.add({x - w / 2, y - h / 2, x + w / 2, y + h / 2}, class_id, score);
                });
}

}  // namespace stillmap
