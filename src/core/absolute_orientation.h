// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/geometry.h"

namespace stillmap {

struct AbsoluteOrientation {
  Pose T_to_from;
  /// False where points in a line or in one place leave the rotation open: others are as good.
  bool unique = false;
};

/// The rigid transform that takes `from` to `to` best in the sense of least squares: the rotation is the
/// quaternion of the largest eigenvalue (Horn, JOSA A 4(4), 1987, section 4). Needs as many of the one as of
/// the other, at least three; else it is the identity, and not unique. No heap.
AbsoluteOrientation absolute_orientation(std::span<const Vec3> from, std::span<const Vec3> to);

}  // namespace stillmap
