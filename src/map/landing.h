// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>

#include "core/geometry.h"
#include "map/voxel.h"

namespace stillmap {

/// Calls `visit(place in the block, where it lands)` for each voxel of the grid whose centre the motion
/// brings from within the block: no gaps, however it is turned. The motion is in voxels.
template <class Visitor>
void for_each_landing(BlockCoordinates at, const Pose& T_new_old, Visitor&& visit) {
  const Vec3 begin{8.0 * at.x, 8.0 * at.y, 8.0 * at.z};
  const Vec3 middle = T_new_old * (begin + Vec3{4, 4, 4});
  const Pose T_old_new = inverse(T_new_old);
  const auto reach = [&](int axis) {
    const Mat3& R = T_new_old.R;
    return 4 * (std::abs(R(axis, 0)) + std::abs(R(axis, 1)) + std::abs(R(axis, 2)));
  };
  const Vec3 to_corner{reach(0), reach(1), reach(2)};
  const VoxelCoordinates first = voxel_at(middle - to_corner), last = voxel_at(middle + to_corner);
  for (std::int32_t z = first.z; z <= last.z; ++z) {
    for (std::int32_t y = first.y; y <= last.y; ++y) {
      for (std::int32_t x = first.x; x <= last.x; ++x) {
        const VoxelCoordinates from = voxel_at(T_old_new * Vec3{x + 0.5, y + 0.5, z + 0.5} - begin);
        const bool inside = ((from.x | from.y | from.z) & ~7) == 0;
        if (inside) visit(place_in_block(from), VoxelCoordinates{x, y, z});
      }
    }
  }
}

}  // namespace stillmap
