// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "core/camera.h"
#include "core/detection.h"
#include "core/dynamic_mask.h"
#include "core/image.h"

namespace stillmap {

/// Marks what moves in one frame. `boxes` are in pixels of this frame, found in it or carried to it; `depth`
/// is registered to colour, in the camera's units, of the camera's size (checked). A pure function: any
/// thread, no heap, 124 KB of stack (GCC's -fstack-usage).
///
/// Off: an empty mask. Paper: the boxes alone (seed paper, Table 2). Silhouette, for each dynamic and
/// semi-static box:
/// - The object is the nearest big heap of depth in the box that its surroundings do not share, with all
///   that hangs together with it in the picture and in depth, up to a little beyond the box.
/// - Where nothing stands out (a keyboard on a desk, a poster on a wall), everything at the box's main depth
///   is the object, and nothing beyond the box.
/// - A box without depth is the object as a whole: its pixels are Unknown, a stray reading in it has the
///   box's label. So are holes in the depth inside the box that touch the object (hair, depth shadows).
/// - Static boxes say nothing: a person before a screen is a person.
/// - A cell that two objects meet holds the nearest one's index and both depths; where a moving object and a
///   semi-static one meet, the moving one has the cell.
void segment(const Detections& boxes, ImageView<const std::uint16_t> depth, const CameraModel& camera,
             DynamicRule rule, DynamicMask& out);

}  // namespace stillmap
