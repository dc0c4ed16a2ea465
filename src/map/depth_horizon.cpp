// SPDX-License-Identifier: Apache-2.0
#include "map/depth_horizon.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace stillmap {

namespace {

std::size_t squares_of(int size_px) {
  return static_cast<std::size_t>((size_px + DepthHorizon::kSquare_px - 1) / DepthHorizon::kSquare_px);
}

/// The first that slopes between `least` and `most` may fall on, and the one after the last.
template <class Slopes>
std::pair<std::size_t, std::size_t> met(Slopes slopes, float least, float most) {
  std::size_t first = 0, end = slopes.size();
  while (first < end && slopes[first].most < least) ++first;
  while (end > first && slopes[end - 1].least > most) --end;
  return {first, end};
}

}  // namespace

DepthHorizon::DepthHorizon(Arena& arena, const CameraModel& camera, const RayTable& rays)
    : width_(camera.width),
      height_(camera.height),
      columns_(arena.take<Slopes>("map_horizon", squares_of(camera.width))),
      rows_(arena.take<Slopes>("map_horizon", squares_of(camera.height))),
      farthest_m_(arena.take<float>("map_horizon", squares_of(camera.width) * squares_of(camera.height))),
      strip_m_(arena.take<float>("map_horizon", static_cast<std::size_t>(camera.width))) {
  if (arena.planning()) return;
  constexpr float kMost = std::numeric_limits<float>::max();
  std::ranges::fill(columns_, Slopes{kMost, -kMost});
  std::ranges::fill(rows_, Slopes{kMost, -kMost});
  const auto widen = [](Slopes& slopes, float slope, double focal_px) {
    // The rays go through pixel centres: half a pixel more belongs to the picture.
    const float half = static_cast<float>(0.5 / focal_px);
    slopes = {std::min(slopes.least, slope - half), std::max(slopes.most, slope + half)};
  };
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      const RayTable::Ray ray = rays.at(x, y);
      widen(columns_[static_cast<std::size_t>(x / kSquare_px)], ray.x, camera.fx);
      widen(rows_[static_cast<std::size_t>(y / kSquare_px)], ray.y, camera.fy);
    }
  }
}

void DepthHorizon::take(std::span<const float> z_m) {
  const std::size_t width = strip_m_.size();
  for (std::size_t row = 0; row < rows_.size(); ++row) {
    std::ranges::fill(strip_m_, 0.0f);
    const int end = std::min((static_cast<int>(row) + 1) * kSquare_px, height_);
    for (int y = static_cast<int>(row) * kSquare_px; y < end; ++y) {
      const float* z = z_m.data() + static_cast<std::ptrdiff_t>(y) * width_;
      float* strip = strip_m_.data();
      for (std::size_t x = 0; x < width; ++x) strip[x] = std::max(strip[x], std::abs(z[x]));
    }
    for (std::size_t column = 0; column < columns_.size(); ++column) {
      const std::size_t first = column * kSquare_px;
      farthest_m_[row * columns_.size() + column] =
          std::ranges::max(strip_m_.subspan(first, std::min<std::size_t>(kSquare_px, width - first)));
    }
  }
}

float DepthHorizon::farthest_m(float x, float y, float z, float radius) const {
  const float near = z - radius, far = z + radius;
  if (near <= 0) return std::numeric_limits<float>::infinity();
  const auto least = [&](float centre) { return (centre - radius) / (centre < radius ? near : far); };
  const auto most = [&](float centre) { return (centre + radius) / (centre < -radius ? far : near); };
  const auto [first_column, end_column] = met(columns_, least(x), most(x));
  const auto [first_row, end_row] = met(rows_, least(y), most(y));
  float farthest = 0;
  for (std::size_t row = first_row; row < end_row; ++row) {
    for (std::size_t column = first_column; column < end_column; ++column)
      farthest = std::max(farthest, farthest_m_[row * columns_.size() + column]);
  }
  return farthest;
}

}  // namespace stillmap
