// SPDX-License-Identifier: Apache-2.0
#include "detect/decoder.h"

#include <algorithm>

#include "core/check.h"
#include "detect/nanodet_decoder.h"
#include "detect/yolo_decoder.h"

namespace stillmap {

std::unique_ptr<Decoder> make_decoder(const std::string& name, const DecoderSetup& setup) {
  if (name == "nanodet_plus") return std::make_unique<NanodetDecoder>(setup, 0.f);
  if (name == "nanodet") return std::make_unique<NanodetDecoder>(setup, 0.5f);
  if (name == "yolov5") return std::make_unique<YoloDecoder>(setup, YoloDecoder::Version::V5);
  if (name == "yolov8") return std::make_unique<YoloDecoder>(setup, YoloDecoder::Version::V8);
  STILLMAP_CHECK(name == "yolox");
  return std::make_unique<YoloDecoder>(setup, YoloDecoder::Version::X);
}

Grid grid_of(const DecoderSetup& setup, int stride_px) {
  const auto cells = [&](int size_px) {
    return static_cast<std::size_t>((size_px + stride_px - 1) / stride_px);
  };
  return {stride_px, cells(setup.input_width), cells(setup.input_height)};
}

std::size_t count_cells(const DecoderSetup& setup) {
  std::size_t cells = 0;
  for (const int stride : setup.strides) cells += grid_of(setup, stride).cells();
  return cells;
}

Decoder::Choice choose_flat(std::span<const Tensor> outputs, const DecoderSetup& setup, std::size_t cells,
                            std::size_t channels_beside_classes, bool cells_inside) {
  Decoder::Choice choice;
  if (setup.strides.empty()) {
    choice.refusal = "needs detector.strides, e.g. [8, 16, 32]";
    return choice;
  }
  std::string found;
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    const Tensor& output = outputs[i];
    const bool fits =
        output.dimensions == 3 && output.size(0) == 1 && output.size(cells_inside ? 2 : 1) == cells;
    const std::size_t channels = output.size(cells_inside ? 1 : 2);
    if (fits && channels > channels_beside_classes) {
      choice.outputs = {i};
      choice.classes = static_cast<int>(channels - channels_beside_classes);
      return choice;
    }
    found += (found.empty() ? "" : ", ") + shape_text(output);
  }
  const std::string channels =
      std::to_string(static_cast<std::size_t>(setup.classes) + channels_beside_classes);
  choice.refusal =
      "has no output [1, " +
      (cells_inside ? channels + ", " + std::to_string(cells) : std::to_string(cells) + ", " + channels) +
      "], but " + found;
  return choice;
}

CellView flat_view(const Tensor& output, bool cells_inside) {
  if (cells_inside) return {output.values.data(), output.size(2), 1, output.size(2)};
  return {output.values.data(), output.size(1), output.size(2), 1};
}

std::string shape_text(const Tensor& tensor) {
  std::string text = "[";
  for (std::size_t i = 0; i < static_cast<std::size_t>(tensor.dimensions); ++i)
    text += (i > 0 ? ", " : "") + std::to_string(tensor.shape[i]);
  return text + "]";
}

}  // namespace stillmap
