// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "core/geometry.h"

namespace stillmap {

/// The rigid transform that takes `from` to `to` best in the sense of least squares (Horn, JOSA A 4(4),
/// 1987). At least three points that are not in a line; nothing otherwise. No heap.
std::optional<Pose> absolute_orientation(std::span<const Vec3> from, std::span<const Vec3> to);

}  // namespace stillmap
