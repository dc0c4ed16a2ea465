// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "detect/decoder.h"

namespace stillmap {

/// The outputs of YOLOv5 and YOLOv8 (github.com/ultralytics) as their own exports write them: boxes (centre
/// and size in px of the input) and probabilities are ready.
class YoloDecoder : public Decoder {
 public:
  /// V5: [1, cells, 4 + 1 + classes], three anchors a cell, the fifth being how sure it is of any object;
  /// V8: [1, 4 + classes, cells].
  enum class Version { V5, V8 };

  YoloDecoder(const DecoderSetup& setup, Version version) : setup_(setup), version_(version) {}
  Choice choose(std::span<const Tensor> outputs) override;
  void decode(std::span<const Tensor> chosen, BoxSelection& boxes) const override;

 private:
  DecoderSetup setup_;
  Version version_;
};

}  // namespace stillmap
