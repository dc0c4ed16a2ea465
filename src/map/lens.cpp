// SPDX-License-Identifier: Apache-2.0
#include "map/lens.h"

#include <cmath>

namespace stillmap {

Lens::Lens(const CameraModel& c, const RayTable& rays, bool planning)
    : fx_(static_cast<float>(c.fx)),
      fy_(static_cast<float>(c.fy)),
      cx_(static_cast<float>(c.cx)),
      cy_(static_cast<float>(c.cy)),
      k1_(static_cast<float>(c.k1)),
      k2_(static_cast<float>(c.k2)),
      p1_(static_cast<float>(c.p1)),
      p2_(static_cast<float>(c.p2)),
      k3_(static_cast<float>(c.k3)),
      width_(static_cast<float>(c.width)),
      height_(static_cast<float>(c.height)),
      near_m_(static_cast<float>(std::max(c.depth_min_m, 0.01))) {
  if (planning) return;
  for (int y = 0; y < c.height; ++y) {
    for (int x = 0; x < c.width; ++x) {
      const RayTable::Ray ray = rays.at(x, y);
      max_r2_ = std::max(max_r2_, ray.x * ray.x + ray.y * ray.y);
      min_x_ = std::min(min_x_, ray.x);
      max_x_ = std::max(max_x_, ray.x);
      min_y_ = std::min(min_y_, ray.y);
      max_y_ = std::max(max_y_, ray.y);
    }
  }
  // The rays go through pixel centres: half a pixel more belongs to the picture.
  const float half_x = 0.5f / fx_, half_y = 0.5f / fy_;
  min_x_ -= half_x;
  max_x_ += half_x;
  min_y_ -= half_y;
  max_y_ += half_y;
  slope_min_x_ = std::sqrt(1 + min_x_ * min_x_);
  slope_max_x_ = std::sqrt(1 + max_x_ * max_x_);
  slope_min_y_ = std::sqrt(1 + min_y_ * min_y_);
  slope_max_y_ = std::sqrt(1 + max_y_ * max_y_);
}

Lens::PixelRow Lens::pixels_of(const std::array<float, 3>& begin, const std::array<float, 3>& step) const {
  PixelRow row;
  for (std::size_t i = 0; i < kRow; ++i) {
    const float s = static_cast<float>(static_cast<int>(i));
    const Pixel p = pixel_of(begin[0] + s * step[0], begin[1] + s * step[1], begin[2] + s * step[2]);
    row.u[i] = p.u;
    row.v[i] = p.v;
  }
  return row;
}

}  // namespace stillmap
