// SPDX-License-Identifier: Apache-2.0
#include "detect/nanodet_decoder.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap {

namespace {

/// The distance in strides that the bins of one side say; NaN where one of them is not finite.
float expected_distance(const CellView& bins, std::size_t cell, std::size_t first, std::size_t count) {
  float top = -std::numeric_limits<float>::infinity();
  for (std::size_t k = 0; k < count; ++k) {
    if (!std::isfinite(bins.at(cell, first + k))) return std::numeric_limits<float>::quiet_NaN();
    top = std::max(top, bins.at(cell, first + k));
  }
  float sum = 0, weighted = 0;
  for (std::size_t k = 0; k < count; ++k) {
    const float e = std::exp(bins.at(cell, first + k) - top);
    sum += e;
    weighted += e * static_cast<float>(k);
  }
  return weighted / sum;
}

std::size_t index_of(std::span<const Tensor> outputs, const std::string& name) {
  return static_cast<std::size_t>(std::ranges::find(outputs, name, &Tensor::name) - outputs.begin());
}

std::string list_text(const std::vector<int>& strides) {
  std::string text = "[";
  for (const int stride : strides) text += (text.size() > 1 ? ", " : "") + std::to_string(stride);
  return text + "]";
}

}  // namespace

NanodetDecoder::NanodetDecoder(const DecoderSetup& setup, float cell_offset)
    : setup_(setup), cell_offset_(cell_offset) {}

Decoder::Choice NanodetDecoder::choose(std::span<const Tensor> outputs) {
  std::vector<int> named;
  for (const int stride : {4, 8, 16, 32, 64, 128}) {
    const bool has_classes = index_of(outputs, "cls_" + std::to_string(stride)) < outputs.size();
    const bool has_distances = index_of(outputs, "reg_" + std::to_string(stride)) < outputs.size();
    if (has_classes != has_distances)
      return {.refusal = "has only one of cls_ and reg_ for stride " + std::to_string(stride)};
    if (has_classes) named.push_back(stride);
  }
  if (!named.empty()) return choose_pairs(outputs, named);
  if (!setup_.strides.empty()) return choose_one(outputs);
  return {.refusal =
              "has no outputs cls_8, reg_8, cls_16, reg_16 ..., and one output needs detector.strides"};
}

Decoder::Choice NanodetDecoder::choose_pairs(std::span<const Tensor> outputs, const std::vector<int>& named) {
  if (setup_.strides.empty()) setup_.strides = named;
  if (setup_.strides != named)
    return {.refusal = "has outputs for the strides " + list_text(named) +
                       ", not for detector.strides = " + list_text(setup_.strides)};
  Choice choice;
  for (const int stride : named) {
    const std::size_t cls = index_of(outputs, "cls_" + std::to_string(stride));
    const std::size_t reg = index_of(outputs, "reg_" + std::to_string(stride));
    const Grid grid = grid_of(setup_, stride);
    const auto fits = [&](const Tensor& t) {
      return t.dimensions == 4 && t.size(0) == 1 && t.size(2) == grid.rows && t.size(3) == grid.columns;
    };
    const std::size_t bins = outputs[reg].size(1) / 4;
    if (bins_ == 0) bins_ = bins;
    const bool good =
        fits(outputs[cls]) && fits(outputs[reg]) && outputs[reg].size(1) == 4 * bins_ && bins_ > 1;
    if (!good) {
      return {.refusal = "has outputs of the wrong shape for stride " + std::to_string(stride) + ": " +
                         shape_text(outputs[cls]) + " and " + shape_text(outputs[reg]) + " where [1, " +
                         std::to_string(setup_.classes) + ", " + std::to_string(grid.rows) + ", " +
                         std::to_string(grid.columns) + "] and 4 x bins planes alike are due"};
    }
    choice.outputs.insert(choice.outputs.end(), {cls, reg});
    choice.classes = outputs[cls].shape[1];
    if (choice.classes != setup_.classes) break;
  }
  return choice;
}

Decoder::Choice NanodetDecoder::choose_one(std::span<const Tensor> outputs) {
  planar_ = false;
  Choice choice = choose_flat(outputs, setup_, count_cells(setup_), 0, false);
  if (!choice.refusal.empty()) return choice;
  // Bins are what the classes leave over.
  const int beside = choice.classes - setup_.classes;
  choice.classes = setup_.classes;
  if (beside < 8 || beside % 4 != 0) {
    choice.refusal = "has " + std::to_string(beside + setup_.classes) + " values a cell, where " +
                     std::to_string(setup_.classes) + " classes (classes.names) and 4 x bins are due";
  }
  bins_ = static_cast<std::size_t>(std::max(0, beside)) / 4;
  return choice;
}

void NanodetDecoder::decode(std::span<const Tensor> chosen, BoxSelection& boxes) const {
  const auto classes = static_cast<std::size_t>(setup_.classes);
  std::size_t first = 0, pair = 0;
  for (const int stride : setup_.strides) {
    const Grid grid = grid_of(setup_, stride);
    if (planar_) {
      const auto plane_view = [&](const Tensor& t) {
        return CellView{t.values.data(), grid.cells(), 1, grid.cells()};
      };
      decode_grid(grid, plane_view(chosen[pair]), plane_view(chosen[pair + 1]), boxes);
      pair += 2;
    } else {
      const CellView view = flat_view(chosen[0], false).part(first, grid.cells());
      decode_grid(grid, view, view.from_channel(classes), boxes);
      first += grid.cells();
    }
  }
}

void NanodetDecoder::decode_grid(const Grid& grid, const CellView& classes, const CellView& distances,
                                 BoxSelection& boxes) const {
  const auto score = static_cast<float>(setup_.score_threshold);
  const float threshold =
      planar_ ? static_cast<float>(std::log(setup_.score_threshold / (1 - setup_.score_threshold))) : score;
  const auto found = [&](std::size_t cell, std::uint16_t class_id, float value) {
    const auto px = static_cast<float>(grid.stride_px);
    std::array<float, 4> distance_px{};
    for (std::size_t side = 0; side < 4; ++side)
      distance_px[side] = px * expected_distance(distances, cell, side * bins_, bins_);
    const float x = (static_cast<float>(grid.column(cell)) + cell_offset_) * px;
    const float y = (static_cast<float>(grid.row(cell)) + cell_offset_) * px;
    boxes.add({x - distance_px[0], y - distance_px[1], x + distance_px[2], y + distance_px[3]}, class_id,
              planar_ ? 1 / (1 + std::exp(-value)) : value);
  };
  for_each_best(classes, static_cast<std::size_t>(setup_.classes), threshold, found);
}

}  // namespace stillmap
