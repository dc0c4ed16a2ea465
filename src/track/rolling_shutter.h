// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/camera.h"
#include "core/feature.h"

namespace stillmap {

/// A rolling shutter exposes row after row, so that a camera which turns sees the top and the bottom of a
/// picture from two directions. Moves each feature's ray and pixel to what the camera would see at the
/// stamp, when the middle row is exposed. `turn_rad` is the camera's rotation (a vector in its own frame)
/// between the exposures of the first row and the last. Translation in that time is left out: at a walk it is
/// 2 cm, and turning costs far more.
void straighten_rows(const CameraModel& camera, Vec3 turn_rad, std::span<Feature> features);

}  // namespace stillmap
