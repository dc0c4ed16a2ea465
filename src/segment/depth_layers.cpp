// SPDX-License-Identifier: Apache-2.0
#include "segment/depth_layers.h"

#include <algorithm>
#include <cmath>

namespace stillmap {

namespace {

constexpr int kSamplesAcross = 4;
constexpr int kSamples = kSamplesAcross * kSamplesAcross;
/// A surface of fewer samples is noise: flying pixels on a depth edge come alone.
constexpr int kMinSamples = 2;

/// Readings of one cell in mm, in rising order.
int sorted_samples(ImageView<const std::uint16_t> depth, const CameraModel& camera, int x_px, int y_px, int cell_px,
                   std::array<std::uint16_t, kSamples>& out) {
  int count = 0;
  for (int j = 0; j < kSamplesAcross; ++j) {
    const int y = y_px + (2 * j + 1) * cell_px / (2 * kSamplesAcross);
    for (int i = 0; i < kSamplesAcross; ++i) {
      const int x = x_px + (2 * i + 1) * cell_px / (2 * kSamplesAcross);
      if (!depth.contains(x, y)) continue;
      const double z_m = camera.depth_m(depth.at(x, y));
      if (z_m <= 0) continue;
      const auto mm = static_cast<std::uint16_t>(std::min(z_m * 1000, 65535.0));
      int place = count++;
      for (; place > 0 && out[static_cast<std::size_t>(place - 1)] > mm; --place) {
        out[static_cast<std::size_t>(place)] = out[static_cast<std::size_t>(place - 1)];
      }
      out[static_cast<std::size_t>(place)] = mm;
    }
  }
  return count;
}

}  // namespace

int surface_gap_mm(const CameraModel& camera, int depth_mm) {
  const double z_m = depth_mm * 1e-3;
  return static_cast<int>(1000 * (0.06 + 0.02 * z_m + 3 * camera.depth_sigma_m(z_m)));
}

void set_grid(int width_px, int height_px, DepthLayers& out) {
  const auto cells_of = [](int px, int cell) { return (px + cell - 1) / cell; };
  out.cell_px = std::max({1, cells_of(width_px, DynamicMask::kMaxColumns), cells_of(height_px, DynamicMask::kMaxRows)});
  out.columns = cells_of(width_px, out.cell_px);
  out.rows = cells_of(height_px, out.cell_px);
}

void read_layers(ImageView<const std::uint16_t> depth, const CameraModel& camera, CellRect where, DepthLayers& out) {
  std::array<std::uint16_t, kSamples> samples;
  for (int row = where.y0; row < where.y1; ++row) {
    for (int column = where.x0; column < where.x1; ++column) {
      auto& layers = out.cells[static_cast<std::size_t>(row * out.columns + column)];
      layers = {};
      const int count = sorted_samples(depth, camera, column * out.cell_px, row * out.cell_px, out.cell_px, samples);
      std::size_t layer = 0;
      for (int begin = 0, end = 1; begin < count && layer < layers.size(); begin = end++) {
        const auto value = [&](int i) { return samples[static_cast<std::size_t>(i)]; };
        while (end < count && value(end) - value(end - 1) <= surface_gap_mm(camera, value(end))) ++end;
        if (end - begin < kMinSamples) continue;
        layers[layer++] = {value(begin), value(end - 1), static_cast<std::uint8_t>(end - begin)};
      }
    }
  }
}

}  // namespace stillmap
