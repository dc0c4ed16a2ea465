// SPDX-License-Identifier: Apache-2.0
#include "track/grey.h"

#include "core/vector_clones.h"

namespace stillmap {

STILLMAP_VECTOR_CLONES void make_grey(ImageView<const Bgr> colour, ImageView<std::uint8_t> grey) {
  for (int y = 0; y < colour.height; ++y) {
    const Bgr* from = colour.row(y);
    std::uint8_t* to = grey.row(y);
    for (int x = 0; x < colour.width; ++x) to[x] = luma(from[x]);
  }
}

}  // namespace stillmap
