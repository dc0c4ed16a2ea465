// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "core/detection.h"
#include "core/fixed_vector.h"
#include "detect/letterbox.h"

namespace stillmap {

/// Overlap of two boxes: area of the intersection over area of the union, 0 where both are empty.
float intersection_over_union(const Box& a, const Box& b);

/// The last step of every decoder: from many overlapping boxes to one for each object. Fixed memory; one
/// thread at a time.
class BoxSelection {
 public:
  /// `kinds` has one entry for each class of the network.
  BoxSelection(const Letterbox& letterbox, std::span<const ClassKind> kinds, double nms_iou);

  void clear() { candidates_.clear(); }
  /// A box in px of the network's input. One that is not finite, or empty after clipping to the picture, is
  /// left out; beyond 512 the weakest go.
  void add(const Box& in_input, std::uint16_t class_id, float score);
  /// Replaces `out`: the best score first, in pixels of the picture, none overlapping a better one of its
  /// class by more than `nms_iou`. Beyond 64 boxes the weakest go.
  void select(FixedVector<Detection, 64>& out);

 private:
  Letterbox letterbox_;
  std::vector<ClassKind> kinds_;
  float nms_iou_;
  FixedVector<Detection, 512> candidates_;  // once full, a heap with the weakest on top
};

}  // namespace stillmap
