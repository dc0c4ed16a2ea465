// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "detect/decoder.h"

namespace stillmap {

/// The outputs of NanoDet and NanoDet-Plus (github.com/RangiLyu/nanodet). Each side's distance is the
/// softmax-weighted mean of its bins times the stride (generalized focal loss: Li et al., NeurIPS 2020, eq. 5
/// with a unit step). Either planar, a pair for each stride: `cls_8` [1, classes, rows, columns] logits and
/// `reg_8` [1, left, top, right, bottom x bins, rows, columns]; or, as the networks' own export writes it,
/// one output [1, cells, classes + 4 x bins], stride after stride, with probabilities in place of logits.
class NanodetDecoder : public Decoder {
 public:
  /// `cell_offset`: where in its cell a box's middle lies, in strides: 0 for NanoDet-Plus, 0.5 for NanoDet.
  NanodetDecoder(const DecoderSetup& setup, float cell_offset);
  Choice choose(std::span<const Tensor> outputs) override;
  void decode(std::span<const Tensor> chosen, BoxSelection& boxes) const override;

 private:
  Choice choose_pairs(std::span<const Tensor> outputs, const std::vector<int>& named);
  Choice choose_one(std::span<const Tensor> outputs);
  void decode_grid(const Grid& grid, const CellView& classes, const CellView& distances,
                   BoxSelection& boxes) const;

  DecoderSetup setup_;
  float cell_offset_;
  bool planar_ = true;
  std::size_t bins_ = 0;
};

}  // namespace stillmap
