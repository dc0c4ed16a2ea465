// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "core/fixed_vector.h"
#include "core/image.h"

namespace stillmap {

struct Corner {
  std::int16_t x = 0, y = 0;
  std::uint8_t score = 0;  ///< the largest threshold at which this still is a corner
  /// Where between the pixels the score peaks, by a parabola along each axis; in 1/128 px, within half a
  /// pixel.
  std::int8_t dx = 0, dy = 0;
};

/// Corners of one cell; the strongest of a cell matter, so a full list keeps what came first and is counted
/// on.
using CellCorners = FixedVector<Corner, 512>;

/// FAST-9 (Rosten and Drummond, ECCV 2006) with 3x3 non-maximum suppression in the rectangle [x0, x1) x [y0,
/// y1), at most 128 px wide, which must keep 19 px from the border: pixels are read in groups of 32.
/// Corners are appended in row order. No heap.
void fast_corners(ImageView<const std::uint8_t> image, int x0, int y0, int x1, int y1, int threshold,
                  CellCorners& out);

}  // namespace stillmap
