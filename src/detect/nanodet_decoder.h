// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>
#include <vector>

#include "core/detection.h"
#include "core/fixed_vector.h"
#include "detect/letterbox.h"

namespace stillmap {

/// Overlap of two boxes: area of the intersection over area of the union, 0 where both are empty.
float intersection_over_union(const Box& a, const Box& b);

/// Turns the outputs of a NanoDet-Plus network into boxes. Fixed memory; one thread at a time.
class NanodetDecoder {
 public:
  /// Bins of each side's distance, which is their softmax-weighted mean times the stride (generalized focal
  /// loss: Li et al., NeurIPS 2020, eq. 5 with a unit step).
  static constexpr int kBins = 8;
  static constexpr int kMaxHeads = 4;
  static constexpr int kMaxColumns = 1280 / 8;

  /// The outputs of one stride, both planar: `classes` [class][row][column] are logits, `distances`
  /// [left, top, right, bottom x kBins][row][column].
  struct Head {
    int stride_px = 0, columns = 0, rows = 0;
    std::span<const float> classes, distances;
  };

  /// `kinds` has one entry for each class of the network.
  NanodetDecoder(std::span<const ClassKind> kinds, double score_threshold, double nms_iou);

  /// Replaces `out`: the best score first, in pixels of the picture. Sizes of the heads' spans
  /// are the caller's promise (checked). Cells with a value that is not finite, and boxes that are empty
  /// after clipping, never come out. Beyond 512 candidates before, or 64 boxes after the suppression, the
  /// weakest go.
  void decode(std::span<const Head> heads, const Letterbox& letterbox, FixedVector<Detection, 64>& out);

 private:
  void collect(const Head& head, const Letterbox& letterbox);
  void add(const Detection& candidate);

  std::vector<ClassKind> kinds_;
  float logit_threshold_, nms_iou_;
  FixedVector<Detection, 512> candidates_;  // once full, a heap with the weakest on top
};

}  // namespace stillmap
