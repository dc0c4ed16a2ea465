// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "detect/decoder.h"

namespace stillmap {

/// The one output of YOLOv5 and YOLOv8 (github.com/ultralytics) and of YOLOX (Ge et al. 2021) as their own
/// exports write it; probabilities are ready.
class YoloDecoder : public Decoder {
 public:
  /// V5: [1, cells, 4 + 1 + classes], three anchors a cell, the fifth being how sure it is of any object; X:
  /// the same with one anchor; V8: [1, 4 + classes, cells]. The four are centre and size in px of the input;
  /// X's are in strides, the centre from the cell's corner and the size as its logarithm, stride after
  /// stride.
  enum class Version { V5, V8, X };

  YoloDecoder(const DecoderSetup& setup, Version version) : setup_(setup), version_(version) {}
  Choice choose(std::span<const Tensor> outputs) override;
  void decode(std::span<const Tensor> chosen, BoxSelection& boxes) const override;

 private:
  void decode_cells(const CellView& view, const Grid& grid, BoxSelection& boxes) const;

  DecoderSetup setup_;
  Version version_;
};

}  // namespace stillmap
