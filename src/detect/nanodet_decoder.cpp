// SPDX-License-Identifier: Apache-2.0
#include "detect/nanodet_decoder.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <tuple>

#include "core/check.h"

namespace stillmap {

namespace {

/// A total order, so that equal scores come out alike on every machine.
bool is_better(const Detection& a, const Detection& b) {
  return std::tuple(-a.score, a.class_id, a.box.x0, a.box.y0, a.box.x1, a.box.y1) <
         std::tuple(-b.score, b.class_id, b.box.x0, b.box.y0, b.box.x1, b.box.y1);
}

/// The distance in strides that the bins of one side say; `step` floats lie between two bins.
std::optional<float> expected_distance(const float* bins, std::size_t step) {
  float top = -std::numeric_limits<float>::infinity();
  for (std::size_t k = 0; k < NanodetDecoder::kBins; ++k) {
    if (!std::isfinite(bins[k * step])) return std::nullopt;
    top = std::max(top, bins[k * step]);
  }
  float sum = 0, weighted = 0;
  for (std::size_t k = 0; k < NanodetDecoder::kBins; ++k) {
    const float e = std::exp(bins[k * step] - top);
    sum += e;
    weighted += e * static_cast<float>(k);
  }
  return weighted / sum;
}

/// The box around the centre of one cell, in pixels of the input.
std::optional<Box> box_at(const NanodetDecoder::Head& head, int column, int row) {
  const std::size_t plane = static_cast<std::size_t>(head.columns) * static_cast<std::size_t>(head.rows);
  const float* bins = head.distances.data() + static_cast<std::size_t>(row * head.columns + column);
  std::array<float, 4> distance_px{};
  for (std::size_t side = 0; side < 4; ++side) {
    const std::optional<float> d = expected_distance(bins + side * NanodetDecoder::kBins * plane, plane);
    if (!d) return std::nullopt;
    distance_px[side] = *d * static_cast<float>(head.stride_px);
  }
  const auto x = static_cast<float>(column * head.stride_px), y = static_cast<float>(row * head.stride_px);
  return Box{x - distance_px[0], y - distance_px[1], x + distance_px[2], y + distance_px[3]};
}

}  // namespace

float intersection_over_union(const Box& a, const Box& b) {
  const float width = std::min(a.x1, b.x1) - std::max(a.x0, b.x0);
  const float height = std::min(a.y1, b.y1) - std::max(a.y0, b.y0);
  if (width <= 0 || height <= 0) return 0;
  const float both = width * height;
  return both / (a.area() + b.area() - both);
}

NanodetDecoder::NanodetDecoder(std::span<const ClassKind> kinds, double score_threshold, double nms_iou)
    : kinds_(kinds.begin(), kinds.end()),
      logit_threshold_(static_cast<float>(std::log(score_threshold / (1 - score_threshold)))),
      nms_iou_(static_cast<float>(nms_iou)) {}

void NanodetDecoder::add(const Detection& candidate) {
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

void NanodetDecoder::collect(const Head& head, const Letterbox& letterbox) {
  const auto columns = static_cast<std::size_t>(head.columns), rows = static_cast<std::size_t>(head.rows);
  STILLMAP_CHECK(head.columns <= kMaxColumns && head.classes.size() == kinds_.size() * columns * rows &&
                 head.distances.size() == 4 * kBins * columns * rows);
  for (std::size_t row = 0; row < rows; ++row) {
    // Class by class along the row, as the memory lies.
    std::array<float, kMaxColumns> best;
    std::array<std::uint16_t, kMaxColumns> best_class{};
    best.fill(logit_threshold_);
    for (std::size_t id = 0; id < kinds_.size(); ++id) {
      const float* logits = head.classes.data() + (id * rows + row) * columns;
      for (std::size_t x = 0; x < columns; ++x) {
        if (logits[x] > best[x]) {
          best[x] = logits[x];
          best_class[x] = static_cast<std::uint16_t>(id);
        }
      }
    }
    for (std::size_t x = 0; x < columns; ++x) {
      if (!(best[x] > logit_threshold_) || !std::isfinite(best[x])) continue;
      const std::optional<Box> in_input = box_at(head, static_cast<int>(x), static_cast<int>(row));
      if (!in_input) continue;
      const Box box = letterbox.to_picture(*in_input);
      if (box.width() <= 0 || box.height() <= 0) continue;
      add({box, best_class[x], kinds_[best_class[x]], 1 / (1 + std::exp(-best[x]))});
    }
  }
}

void NanodetDecoder::decode(std::span<const Head> heads, const Letterbox& letterbox,
                            FixedVector<Detection, 64>& out) {
  candidates_.clear();
  for (const Head& head : heads) collect(head, letterbox);
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
