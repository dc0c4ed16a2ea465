// SPDX-License-Identifier: Apache-2.0
#include "map/map_queries.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace stillmap {

namespace {

/// The nearer of two distances that there may not be.
std::optional<double> nearer(std::optional<double> a, std::optional<double> b) {
  if (!a || !b) return a ? a : b;
  return std::min(*a, *b);
}

bool is_finite(Vec3 v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

/// Walks the voxels along a ray; all lengths in voxels.
class VoxelWalk {
 public:
  VoxelWalk(Vec3 from, Vec3 unit) : at_(voxel_at(from)) {
    begin_axis(0, from.x, unit.x);
    begin_axis(1, from.y, unit.y);
    begin_axis(2, from.z, unit.z);
  }
  VoxelCoordinates at() const { return at_; }
  /// Where the ray enters the voxel.
  double distance() const { return distance_; }
  void next() {
    const std::size_t axis = static_cast<std::size_t>(std::ranges::min_element(next_) - next_.begin());
    distance_ = next_[axis];
    next_[axis] += pace_[axis];
    (axis == 0 ? at_.x : axis == 1 ? at_.y : at_.z) += step_[axis];
  }

 private:
  void begin_axis(std::size_t axis, double from, double unit) {
    constexpr double kNever = std::numeric_limits<double>::infinity();
    step_[axis] = unit < 0 ? -1 : 1;
    pace_[axis] = unit == 0 ? kNever : 1 / std::abs(unit);
    const double within = from - std::floor(from);
    next_[axis] = unit == 0 ? kNever : (unit < 0 ? within : 1 - within) * pace_[axis];
  }
  VoxelCoordinates at_;
  double distance_ = 0;
  std::array<std::int32_t, 3> step_{};
  std::array<double, 3> pace_{}, next_{};  // between two faces, and to the next face, of each axis
};

}  // namespace

Occupancy MapQueries::voxel(VoxelCoordinates at) const {
  return map_.blocks().published(block_of(at), place_in_block(at));
}

Occupancy MapQueries::at(Vec3 p_map) const {
  // Refuses NaN as well.
  const double far_m = VoxelMap::kMaxDistance_m;
  if (!(std::abs(p_map.x) < far_m && std::abs(p_map.y) < far_m && std::abs(p_map.z) < far_m))
    return Occupancy::Unknown;
  return voxel(voxel_at(1 / map_.voxel_m() * p_map));
}

MapQueries::Ray MapQueries::cast_ray(Vec3 from_map, Vec3 direction, double max_m) const {
  const double length = norm(direction), far_m = VoxelMap::kMaxDistance_m / 2;
  if (!(length > 0) || !is_finite(direction) || !is_finite(from_map) || !(norm(from_map) < far_m))
    return {std::nullopt, 0.0};
  const double edge_m = map_.voxel_m(), end = std::min(max_m, kMaxRay_m) / edge_m;
  Ray ray;
  for (VoxelWalk walk(1 / edge_m * from_map, 1 / length * direction); walk.distance() <= end; walk.next()) {
    const Occupancy here = voxel(walk.at());
    if (here == Occupancy::Free) continue;
    const double distance_m = walk.distance() * edge_m;
    if (here == Occupancy::Occupied) {
      ray.occupied_m = distance_m;
      return ray;
    }
    if (!ray.unknown_m) ray.unknown_m = distance_m;
  }
  return ray;
}

MapQueries::Ray MapQueries::sweep(Vec3 from_map, Vec3 direction, double radius_m, double max_m) const {
  Ray nearest = cast_ray(from_map, direction, max_m);
  const double length = norm(direction);
  if (!(length > 0) || !is_finite(direction) || !(radius_m > 0)) return nearest;
  // Two unit vectors across the direction; the first stands on the axis that it leans on least.
  const Vec3 d = 1 / length * direction;
  const double x = std::abs(d.x), y = std::abs(d.y), z = std::abs(d.z);
  const Vec3 least = x <= y && x <= z ? Vec3{1, 0, 0} : y <= z ? Vec3{0, 1, 0} : Vec3{0, 0, 1};
  const Vec3 across = cross(d, least), u = 1 / norm(across) * across, v = cross(d, u);
  const double radius = std::min(radius_m, kMaxRadius_m), edge_m = map_.voxel_m();
  const int reach = static_cast<int>(std::ceil(radius / edge_m));
  for (int i = -reach; i <= reach; ++i) {
    for (int j = -reach; j <= reach; ++j) {
      // The outermost rays are on the rim, so that the body's full width is looked at.
      const double a = i * radius / reach, b = j * radius / reach;
      if (a * a + b * b > radius * radius || (i == 0 && j == 0)) continue;
      const Ray ray = cast_ray(from_map + a * u + b * v, d, max_m);
      nearest = {nearer(nearest.occupied_m, ray.occupied_m), nearer(nearest.unknown_m, ray.unknown_m)};
    }
  }
  return nearest;
}

Status MapQueries::slice(const Slice& s, std::span<Occupancy> out) const {
  const auto wrong = [](const char* message) { return Error{ExitCode::WrongConfig, message}; };
  if (!z_is_up_)
    return wrong("the map does not know which way is up, so it has no slice; set camera.T_base_camera");
  const double edge_m = map_.voxel_m(), far_m = VoxelMap::kMaxDistance_m / 2;
  const Vec3 begin{s.x_m, s.y_m, s.from_z_m};
  const bool placed = is_finite(begin) && norm(begin) < far_m;
  const double height_m = s.to_z_m - s.from_z_m;
  if (!placed || !(height_m >= 0 && height_m <= kMaxHeight_m) || s.columns <= 0 || s.rows <= 0 ||
      static_cast<std::size_t>(s.columns) > out.size() / static_cast<std::size_t>(s.rows))
    return wrong(
        "the slice is empty, higher than 20 m or larger than the room for it; check its heights and size");
  const VoxelCoordinates first = voxel_at(1 / edge_m * begin);
  const std::int32_t last_z = voxel_at({0, 0, s.to_z_m / edge_m}).z;
  std::size_t cell = 0;
  for (int y = 0; y < s.rows; ++y) {
    for (int x = 0; x < s.columns; ++x, ++cell) {
      Occupancy column = Occupancy::Unknown;
      for (std::int32_t z = first.z; z <= last_z && column != Occupancy::Occupied; ++z) {
        const Occupancy here = voxel({first.x + x, first.y + y, z});
        if (here != Occupancy::Unknown) column = here;
      }
      out[cell] = column;
    }
  }
  return {};
}

}  // namespace stillmap
