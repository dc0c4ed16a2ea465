// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <span>
#include <utility>

#include "core/arena.h"
#include "core/camera.h"
#include "core/geometry.h"
#include "map/lens.h"
#include "map/voxel.h"

namespace stillmap {

/// The air between surfaces, where the map has no blocks: one bit for each cube of a block's edge or, where
/// blocks are small, of at least kLeastCell_m, which says that all of it was seen through. One thread writes,
/// any may ask. In fixed memory: when it is full, what came first at a place gives way to what comes now.
class FreeSpace {
 public:
  static constexpr double kLeastCell_m = 0.25;

  /// `rays` must be of this camera and outlive this.
  FreeSpace(Arena& arena, const CameraModel& camera, const RayTable& rays, double voxel_m,
            double max_range_m);

  /// Notes the cubes that lie wholly in view and before everything measured there. `z_m` as MeasuredDepth has
  /// it. About 0.2 ms.
  void see(const Pose& T_map_camera_depth, std::span<const float> z_m);
  /// Something stands in this block.
  void fill(BlockCoordinates at);
  void clear();
  /// Whether the block lies in air. Any thread.
  bool free(BlockCoordinates at) const;

 private:
  static constexpr int kTile_px = 16, kSampled_px = 4;
  static constexpr std::size_t kChunks = 2048, kProbes = 8;
  /// 8 x 8 x 8 cubes, one word per z.
  struct Chunk {
    std::atomic<std::uint64_t> key{0};  // 0: none
    std::array<std::atomic<std::uint64_t>, 8> words{};
  };
  struct Place {
    std::uint64_t key = 0;
    std::size_t home = 0, word = 0;
    std::uint64_t bit = 0;
  };

  Place place_of(std::int32_t x, std::int32_t y, std::int32_t z) const;
  Place place_of(BlockCoordinates at) const {
    return place_of(at.x >> shift_, at.y >> shift_, at.z >> shift_);
  }
  const Chunk* find(const Place& place) const;
  Chunk* find(const Place& place) { return const_cast<Chunk*>(std::as_const(*this).find(place)); }
  void mark(const Place& place);
  void measure_tiles(std::span<const float> z_m);
  float tile_m(int column, int row) const;
  /// False where a cube around this point of the camera's frame cannot be.
  bool may_be_seen_through(Vec3 middle) const;
  /// Whether all of a cube, given by its corners in the camera's frame, is in view and seen through.
  bool seen_through(const std::array<Vec3, 8>& corners) const;

  Lens lens_;
  const RayTable& rays_;
  int width_, height_, columns_, rows_;
  int shift_;  // of a block's coordinates to a cube's
  double cell_m_, far_m_;
  std::span<float> tiles_m_;  // the least depth in each square of the picture; 0: too little is known
  std::span<Chunk> chunks_;
};

}  // namespace stillmap
