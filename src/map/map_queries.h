// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "core/geometry.h"
#include "core/status.h"
#include "map/voxel.h"
#include "map/voxel_map.h"

namespace stillmap {

/// What a planner asks of a map while it goes on being fused. Any number of threads at once; nothing waits,
/// nothing comes from the heap, and each call's work is bounded by its arguments. Each answer is of one
/// moment of its voxel; two voxels of one call may be a fused frame apart. The map must outlive the queries.
///
/// A voxel costs about 20 ns. Places farther than 2^20 blocks (at 4 cm voxels 335 km) from the map's origin
/// are Unknown.
class MapQueries {
 public:
  /// `z_is_up`: the map's z axis points away from gravity (camera.T_base_camera is set).
  MapQueries(const VoxelMap& map, bool z_is_up) : map_(map), z_is_up_(z_is_up) {}

  /// What is known of a point of the map frame, m.
  Occupancy at(Vec3 p_map) const;

  /// What lies on a ray, as distances from its origin in m to where the ray enters the voxel; nothing where
  /// there is none up to `max_m`. Beyond the first occupied voxel nothing is looked at.
  struct Ray {
    std::optional<double> occupied_m, unknown_m;
    bool is_free() const { return !occupied_m && !unknown_m; }
  };
  /// Visits every voxel that the ray touches (Amanatides and Woo, Eurographics 1987). `direction` need not be
  /// of unit length; of length zero or not finite, the answer is unknown at 0. At most kMaxRay_m far.
  Ray cast_ray(Vec3 from_map, Vec3 direction, double max_m) const;
  static constexpr double kMaxRay_m = 100;

  /// The nearest obstacle for a round body of `radius_m` (at most kMaxRadius_m) that goes along the
  /// direction: rays one voxel apart that fill its cross-section, and of them all the nearest distances.
  Ray sweep(Vec3 from_map, Vec3 direction, double radius_m, double max_m) const;
  static constexpr double kMaxRadius_m = 1;

  /// The map from above: cells of one voxel, `columns` along x and `rows` along y from the voxel around
  /// (x_m, y_m); a column of voxels between two heights is Occupied where one of it is, Free where one is
  /// free and none occupied, else Unknown.
  struct Slice {
    double x_m = 0, y_m = 0, from_z_m = 0, to_z_m = 0;
    int columns = 0, rows = 0;
  };
  /// `out` is row-major from the lowest y, and has room for columns * rows. The error (WrongConfig): up is
  /// not known, or the slice is empty, higher than kMaxHeight_m or wider than `out`.
  Status slice(const Slice& slice, std::span<Occupancy> out) const;
  static constexpr double kMaxHeight_m = 20;

 private:
  Occupancy voxel(VoxelCoordinates at) const;

  const VoxelMap& map_;
  bool z_is_up_;
};

}  // namespace stillmap
