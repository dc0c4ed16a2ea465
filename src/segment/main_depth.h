// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "segment/depth_layers.h"

namespace stillmap {

/// The depths at which the object of a box has its bulk: the nearest big heap of depth in the box, the middle
/// of the box weighing most, less what its surroundings have as well. Where the box has nothing that the
/// surroundings lack, its biggest heap. Empty where the box has next to no depth.
DepthRange main_depth(const DepthLayers& grid, const BoxCells& cells);

}  // namespace stillmap
