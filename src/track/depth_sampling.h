// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "core/camera.h"
#include "core/feature.h"
#include "core/image.h"

namespace stillmap {

/// The pixel of the depth picture that shows what a feature shows; nothing where that is outside. The depth
/// picture is taken a little before or after the colour picture, and when the camera turns, a corner is
/// elsewhere by then. `T_depth_colour` is the camera's motion between the two exposures (maps points of the
/// camera at the colour stamp to the camera at the depth stamp); of it the rotation, which dominates: the
/// translation of a few milliseconds moves a pixel by a small part of one. The feature's ray is to be that of
/// the colour stamp (`straighten_rows`): depth is taken as if all of it were of its own stamp.
std::optional<Vec2> depth_pixel(const CameraModel& camera, const Pose& T_depth_colour,
                                const Feature& feature);

/// Gives each feature the depth at its `depth_pixel`. A corner on the edge of two surfaces belongs to the
/// nearer one, whose reading is taken when the 3x3 readings split; where the readings are too few, depth is
/// 0.
void sample_depth(ImageView<const std::uint16_t> depth, const CameraModel& camera, const Pose& T_depth_colour,
                  std::span<Feature> features);

}  // namespace stillmap
