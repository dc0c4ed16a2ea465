// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/camera.h"
#include "core/feature.h"
#include "core/image.h"

namespace stillmap {

/// Gives each feature its depth. The depth picture is taken a little before or after the colour picture; when
/// the camera turns, a corner's depth is elsewhere by then. `T_depth_colour` is the camera's predicted motion
/// between the two exposures (maps points of the camera at the colour stamp to the camera at the depth
/// stamp). A corner on the edge of two surfaces belongs to the nearer one, whose reading is taken when the
/// 3x3 readings split; where the readings are too few, depth is 0.
void sample_depth(ImageView<const std::uint16_t> depth, const CameraModel& camera, const Pose& T_depth_colour,
                  std::span<Feature> features);

}  // namespace stillmap
