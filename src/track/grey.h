// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/image.h"

namespace stillmap {

/// The luma of each pixel of `colour`; `grey` is of the same size.
void make_grey(ImageView<const Bgr> colour, ImageView<std::uint8_t> grey);

}  // namespace stillmap
