// SPDX-License-Identifier: Apache-2.0
#include "segment/main_depth.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace stillmap {

namespace {

/// Bins of 8 % from 0.2 m (to 50 m): two make about a person's thickness at the range where one fills a
/// picture.
constexpr std::size_t kBins = 72;
constexpr float kFirstMm = 200, kBinsPerOctave = 9;
/// A box with a smaller share of the readings that it could have is without depth.
constexpr float kMinReadings = 0.05f;
/// What the box has beyond its surroundings must be this share of it, or nothing stands out.
constexpr float kMinContrast = 0.1f;
/// The nearest heap of at least this share of the biggest is the object: it stands before what is bigger.
constexpr float kBigHeap = 0.5f;
constexpr float kSamplesPerCell = 16;

std::size_t bin_of(int depth_mm) {
  const float ratio = std::max(static_cast<float>(depth_mm), kFirstMm) / kFirstMm;
  return std::min(static_cast<std::size_t>(kBinsPerOctave * std::log2(ratio)), kBins - 1);
}
int start_of(std::size_t bin) {
  return static_cast<int>(kFirstMm * std::exp2(static_cast<float>(bin) / kBinsPerOctave));
}

/// How much of an area lies at which depth.
struct DepthHistogram {
  std::array<float, kBins> readings{};
  float possible = 0;

  void add(const DepthLayers::Cell& cell, float weight) {
    for (const DepthLayer& layer : cell) {
      if (layer.samples > 0)
        readings[bin_of(layer.middle_mm())] += weight * static_cast<float>(layer.samples);
    }
    possible += weight * kSamplesPerCell;
  }
  /// Of the bin and its neighbours, in the area.
  float share(std::size_t bin) const {
    return possible > 0 ? (readings[bin - 1] + readings[bin] + readings[bin + 1]) / possible : 0;
  }
};

}  // namespace

DepthRange main_depth(const DepthLayers& grid, const BoxCells& cells) {
  DepthHistogram inside, outside;
  const CellRect& box = cells.box;
  const float half_w = 0.5f * static_cast<float>(box.x1 - box.x0),
              half_h = 0.5f * static_cast<float>(box.y1 - box.y0);
  for (int row = cells.around.y0; row < cells.around.y1; ++row) {
    for (int column = cells.around.x0; column < cells.around.x1; ++column) {
      if (box.contains(column, row)) {
        const float u = (static_cast<float>(column - box.x0) + 0.5f) / half_w - 1;
        const float v = (static_cast<float>(row - box.y0) + 0.5f) / half_h - 1;
        inside.add(grid.at(column, row), (1 - 0.8f * u * u) * (1 - 0.8f * v * v));
      } else {
        outside.add(grid.at(column, row), 1);
      }
    }
  }
  float readings = 0, best_contrast = 0;
  for (const float count : inside.readings) readings += count;
  if (readings <= kMinReadings * inside.possible) return {};

  std::array<float, kBins> contrast{};
  std::size_t chosen = 1;
  for (std::size_t i = 1; i + 1 < kBins; ++i) {
    contrast[i] = inside.share(i) - outside.share(i);
    best_contrast = std::max(best_contrast, contrast[i]);
    if (inside.share(i) > inside.share(chosen)) chosen = i;
  }
  if (best_contrast > kMinContrast) {
    chosen = 1;
    while (contrast[chosen] < kBigHeap * best_contrast) ++chosen;
    while (chosen + 2 < kBins && contrast[chosen + 1] > contrast[chosen]) ++chosen;
  }
  return {start_of(chosen - 1), start_of(chosen + 2)};
}

}  // namespace stillmap
