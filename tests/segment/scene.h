// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/camera.h"
#include "core/detection.h"
#include "tests/support/read_image.h"

namespace stillmap::test {

/// Depth pictures of simple rooms, in mm, 640x480 unless told.
struct Scene {
  CameraModel camera;
  Image<std::uint16_t> depth;

  explicit Scene(int width = 640, int height = 480) : depth(width, height) {
    camera.width = width;
    camera.height = height;
    camera.fx = camera.fy = 0.8 * width;
    camera.cx = 0.5 * width;
    camera.cy = 0.5 * height;
    camera.depth_units_per_m = 1000;
  }
  /// Paints pixels (x, y) of [x0, x1) x [y0, y1) with depth_mm(x, y) where that is nearer than what is there.
  template <class Depth>
  void paint(int x0, int y0, int x1, int y1, Depth depth_mm) {
    for (int y = std::max(y0, 0); y < std::min(y1, depth.height); ++y) {
      for (int x = std::max(x0, 0); x < std::min(x1, depth.width); ++x) {
        std::uint16_t& at = depth.view().at(x, y);
        const auto mm = static_cast<std::uint16_t>(depth_mm(x, y));
        if (at == 0 || mm < at) at = mm;
      }
    }
  }
  void wall(int mm) {
    paint(0, 0, depth.width, depth.height, [=](int, int) { return mm; });
  }
  /// A floor this far below a level camera.
  void floor(int below_mm) {
    paint(0, static_cast<int>(camera.cy) + 1, depth.width, depth.height,
          [this, below_mm](int, int y) { return std::min(60000.0, camera.fy * below_mm / (y - camera.cy)); });
  }
  /// An upright body, rounded by 15 cm from the middle to the sides.
  void body(int x0, int y0, int x1, int y1, int mm) {
    paint(x0, y0, x1, y1, [=](int x, int) {
      const double u = 2.0 * (x - x0) / (x1 - x0) - 1;
      return mm + 150 * u * u;
    });
  }
  void hole(int x0, int y0, int x1, int y1) {
    for (int y = y0; y < y1; ++y) std::fill_n(depth.view().row(y) + x0, x1 - x0, std::uint16_t{0});
  }
  double depth_m(int x, int y) const { return camera.depth_m(depth.view().at(x, y)); }
};

inline Detection box_of(float x0, float y0, float x1, float y1, ClassKind kind = ClassKind::Dynamic) {
  Detection d;
  d.box = {x0, y0, x1, y1};
  d.kind = kind;
  d.score = 0.9f;
  return d;
}

}  // namespace stillmap::test
