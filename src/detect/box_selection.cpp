// SPDX-License-Identifier: Apache-2.0
#include "detect/box_selection.h"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace stillmap {

namespace {

/// A total order, so that equal scores come out alike on every machine.
bool is_better(const Detection& a, const Detection& b) {
  return std::tuple(-a.score, a.class_id, a.box.x0, a.box.y0, a.box.x1, a.box.y1) <
         std::tuple(-b.score, b.class_id, b.box.x0, b.box.y0, b.box.x1, b.box.y1);
}

}  // namespace

float intersection_over_union(const Box& a, const Box& b) {
  const float width = std::min(a.x1, b.x1) - std::max(a.x0, b.x0);
  const float height = std::min(a.y1, b.y1) - std::max(a.y0, b.y0);
  if (width <= 0 || height <= 0) return 0;
  const float both = width * height;
  return both / (a.area() + b.area() - both);
}

BoxSelection::BoxSelection(const Letterbox& letterbox, std::span<const ClassKind> kinds, double nms_iou)
    : letterbox_(letterbox), kinds_(kinds.begin(), kinds.end()), nms_iou_(static_cast<float>(nms_iou)) {}

void BoxSelection::add(const Box& in_input, std::uint16_t class_id, float score) {
  const bool is_finite = std::isfinite(in_input.x0) && std::isfinite(in_input.y0) &&
                         std::isfinite(in_input.x1) && std::isfinite(in_input.y1);
  if (!is_finite) return;
  const Detection candidate{letterbox_.to_picture(in_input), class_id, kinds_[class_id], score};
  if (candidate.box.width() <= 0 || candidate.box.height() <= 0) return;
  if (candidates_.try_push_back(candidate)) {
    if (candidates_.size() == candidates_.capacity())
      std::make_heap(candidates_.begin(), candidates_.end(), is_better);
    return;
  }
  if (!is_better(candidate, candidates_[0])) return;
  std::pop_heap(candidates_.begin(), candidates_.end(), is_better);
  candidates_[candidates_.size() - 1] = candidate;
  std::push_heap(candidates_.begin(), candidates_.end(), is_better);
}

void BoxSelection::select(FixedVector<Detection, 64>& out) {
  std::sort(candidates_.begin(), candidates_.end(), is_better);
  out.clear();
  for (const Detection& candidate : candidates_) {
    const bool is_new = std::none_of(out.begin(), out.end(), [&](const Detection& kept) {
      return kept.class_id == candidate.class_id &&
             intersection_over_union(kept.box, candidate.box) > nms_iou_;
    });
    if (is_new && !out.try_push_back(candidate)) break;
  }
}

}  // namespace stillmap
