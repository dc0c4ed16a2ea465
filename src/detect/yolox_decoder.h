// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "detect/decoder.h"

namespace stillmap {

/// The output of YOLOX (Ge et al. 2021) as its own export writes it: [1, cells, 4 + 1 + classes], stride
/// after stride; centre from the cell's corner and logarithm of the size, both in strides; probabilities are
/// ready.
class YoloxDecoder : public Decoder {
 public:
  explicit YoloxDecoder(const DecoderSetup& setup) : setup_(setup) {}
  Choice choose(std::span<const Tensor> outputs) override;
  void decode(std::span<const Tensor> chosen, BoxSelection& boxes) const override;

 private:
  DecoderSetup setup_;
};

}  // namespace stillmap
