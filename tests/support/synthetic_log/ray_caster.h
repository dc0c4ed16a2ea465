// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/camera.h"
#include "tests/support/synthetic_log/shape.h"
#include "tests/support/synthetic_log/texture.h"

namespace stillmap::synthetic {

/// Finds, for each pixel, the nearest surface among a room and some hundred shapes. Shapes are sorted into 16
/// x 16 pixel tiles by their projected bounds, so that a ray meets a handful of them. Reuses its memory.
class RayCaster {
 public:
  RayCaster(const CameraModel& camera, const RoomShell& room, const std::vector<Texture>& materials);

  /// Sets the view: the next calls see `shapes` (which must live that long) from this pose. The offset moves
  /// all rays by a part of a pixel.
  void look(const Pose& T_world_camera, std::span<const Shape> shapes, double x_offset_px,
            double y_offset_px);

  /// Depth along the optical axis in m, and whose body it is (0: the room's), of every pixel.
  void cast(std::span<float> depth_m, std::span<std::uint8_t> figure) const;
  /// Adds the lit colour of every pixel (r, g, b from 0 to 255) to `sums`.
  void add_colour(std::span<std::array<std::uint16_t, 3>> sums) const;

 private:
  struct F3 {
    float x = 0, y = 0, z = 0;
  };
  /// A shape in the camera's view. q = origin + t * (x * dx + y * dy + dz) is the point at depth t of the ray
  /// (x, y, 1) in the shape's own coordinates, where its half sizes are 1.
  struct Seen {
    F3 origin, dx, dy, dz;
    ShapeKind kind = ShapeKind::Box;
    float straight = 0;  ///< a capsule's half length without the ends, in its radius
    float nearest_m = 0;
    const Shape* shape = nullptr;
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  ///< the tiles it may cover, inclusive
  };
  struct Hit {
    float t = 0;
    const Seen* seen = nullptr;  ///< nullptr: the room itself
  };
  /// What the light needs to know about a surface.
  struct Skin {
    F3 normal;
    const Texture* texture = nullptr;
    float u = 0, v = 0, texels_per_m = 1, tint = 1;
  };
  static constexpr int kTilePx = 16;

  bool project(const Shape& shape, Seen& seen) const;
  static float intersect(const Seen& seen, F3 d);
  Hit trace(std::span<const std::uint16_t> candidates, float x, float y) const;
  Skin skin_of_room(F3 world) const;
  static F3 direction(const Seen& s, float x, float y) {
    return {x * s.dx.x + y * s.dy.x + s.dz.x, x * s.dx.y + y * s.dy.y + s.dz.y,
            x * s.dx.z + y * s.dy.z + s.dz.z};
  }
  Skin skin_of_box(const Seen& seen, F3 q) const;
  Skin skin_of_round(const Seen& seen, F3 q) const;
  Skin skin(const Hit& hit, float x, float y, F3 world) const;
  template <class PerPixel>
  void for_each_pixel(PerPixel per_pixel) const;

  CameraModel camera_;
  RoomShell room_;
  std::span<const Texture> materials_;
  int columns_, rows_;
  Pose T_world_camera_;
  F3 position_, right_, down_, forward_;  ///< T_world_camera_ in float
  float x_offset_px_ = 0, y_offset_px_ = 0;
  std::vector<Seen> seen_;
  std::vector<std::vector<std::uint16_t>> tiles_;
};

}  // namespace stillmap::synthetic
