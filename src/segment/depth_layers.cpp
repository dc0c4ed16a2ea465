// SPDX-License-Identifier: Apache-2.0
#include "segment/depth_layers.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap {

namespace {

constexpr int kSamplesAcross = 4;
constexpr int kSamples = kSamplesAcross * kSamplesAcross;
/// A surface of fewer samples is noise: flying pixels on a depth edge come alone.
constexpr int kMinSamples = 2;
constexpr double kReliefMm = 30, kReliefShare = 0.01, kNoiseSigmas = 3;

int cells_across(int px, int cell_px) {
  return (px + cell_px - 1) / cell_px;
}

/// Trusted readings of one cell.
struct Samples {
  std::array<int, kSamples> mm;
  int count = 0, min_mm = std::numeric_limits<int>::max(), max_mm = 0;
  int at(int i) const { return mm[static_cast<std::size_t>(i)]; }
  void add(int value_mm) {
    mm[static_cast<std::size_t>(count++)] = value_mm;
    min_mm = std::min(min_mm, value_mm);
    max_mm = std::max(max_mm, value_mm);
  }
};

/// Turns raw readings into trusted millimetres.
struct DepthUnits {
  float mm_per_unit, min_mm, max_mm;
  explicit DepthUnits(const CameraModel& camera)
      : mm_per_unit(static_cast<float>(1000 / camera.depth_units_per_m)),
        min_mm(static_cast<float>(std::max(1.0, 1000 * camera.depth_min_m))),
        max_mm(static_cast<float>(std::min(65535.0, 1000 * camera.depth_max_m))) {}

  /// From at most kSamples pixels spread over the square with its corner at (x0, y0).
  Samples sample(ImageView<const std::uint16_t> depth, int x0, int y0, int size_px) const {
    Samples samples;
    for (int j = 0; j < kSamplesAcross; ++j) {
      const int y = y0 + (2 * j + 1) * size_px / (2 * kSamplesAcross);
      if (y >= depth.height) break;
      for (int i = 0; i < kSamplesAcross; ++i) {
        const int x = x0 + (2 * i + 1) * size_px / (2 * kSamplesAcross);
        if (x >= depth.width) break;
        const float mm = static_cast<float>(depth.at(x, y)) * mm_per_unit;
        if (mm >= min_mm && mm <= max_mm) samples.add(static_cast<int>(mm));
      }
    }
    return samples;
  }
};

DepthLayer layer_of(int near_mm, int far_mm, int samples) {
  return {static_cast<std::uint16_t>(near_mm), static_cast<std::uint16_t>(far_mm),
          static_cast<std::uint16_t>(samples)};
}

}  // namespace

DepthLayers::DepthLayers(const CameraModel& camera) {
  cell_px_ = std::max({1, cells_across(camera.width, DynamicMask::kMaxColumns),
                       cells_across(camera.height, DynamicMask::kMaxRows)});
  columns_ = cells_across(camera.width, cell_px_);
  rows_ = cells_across(camera.height, cell_px_);
  for (std::size_t i = 0; i < gaps_mm_.size(); ++i) {
    const double z_mm = static_cast<double>(i) * kGapStepMm;
    const double gap =
        kReliefMm + kReliefShare * z_mm + 1000 * kNoiseSigmas * camera.depth_sigma_m(z_mm / 1000);
    gaps_mm_[i] = static_cast<std::uint16_t>(std::min(gap, 65535.0));
  }
}

void DepthLayers::read(ImageView<const std::uint16_t> depth, const CameraModel& camera, CellRect where) {
  const DepthUnits units(camera);
  for (int row = where.y0; row < where.y1; ++row) {
    for (int column = where.x0; column < where.x1; ++column) {
      Samples samples = units.sample(depth, column * cell_px_, row * cell_px_, cell_px_);
      Cell& cell = cells_[index(column, row)];
      cell = {};
      if (samples.count < kMinSamples) continue;
      if (samples.max_mm - samples.min_mm <= surface_gap_mm(samples.min_mm)) {  // most cells: no need to sort
        cell[0] = layer_of(samples.min_mm, samples.max_mm, samples.count);
        continue;
      }
      std::sort(samples.mm.begin(), samples.mm.begin() + samples.count);
      std::size_t layer = 0;
      for (int begin = 0, end = 1; begin < samples.count && layer < cell.size(); begin = end++) {
        while (end < samples.count &&
               samples.at(end) - samples.at(end - 1) <= surface_gap_mm(samples.at(end)))
          ++end;
        if (end - begin >= kMinSamples)
          cell[layer++] = layer_of(samples.at(begin), samples.at(end - 1), end - begin);
      }
    }
  }
}

BoxCells DepthLayers::cells_of(const Box& box, double beyond_px) const {
  // A box carried along may lie anywhere, even nowhere (NaN, which counts as 0).
  const auto clip = [](double cell, int limit) {
    return cell > 0 ? static_cast<int>(std::min(cell, static_cast<double>(limit))) : 0;
  };
  const auto cells = [&](double grow_px) {
    return CellRect{clip(std::floor((box.x0 - grow_px) / cell_px_), columns_),
                    clip(std::floor((box.y0 - grow_px) / cell_px_), rows_),
                    clip(std::ceil((box.x1 + grow_px) / cell_px_), columns_),
                    clip(std::ceil((box.y1 + grow_px) / cell_px_), rows_)};
  };
  return {cells(0), cells(std::max<double>(beyond_px, cell_px_))};
}

}  // namespace stillmap
