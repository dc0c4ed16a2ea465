// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/dynamic_mask.h"
#include "core/geometry.h"
#include "core/image.h"

namespace stillmap {

/// Where movers were in the last few fused frames, in the map frame. A mask now and then misses a leg, or a
/// whole person for a frame or two; what comes up within arm's length of a place that a mover has just been
/// in is then most likely the mover, and waits until the mover has gone on.
///
/// Cells of 8 cm in a fixed table, each with the frame of its last mark; where a bucket of the table is full,
/// the oldest mark gives way. One thread.
class MoverTrail {
 public:
  /// `rays` must be of this camera and outlive the trail.
  MoverTrail(Arena& arena, const CameraModel& camera, const RayTable& rays);

  /// Goes one frame on, and marks the movers of `mask`, which belongs to the depth picture. Only silhouettes
  /// are marked: a box of the paper's rule takes in what is behind the mover.
  void add_frame(ImageView<const std::uint16_t> depth, const DynamicMask& mask,
                 const Pose& T_map_camera_depth, double max_range_m);
  /// Whether a mover was within kReach_m of the point in the newest frame or the kFrames before it.
  bool near(Vec3 p_map) const;

  static constexpr double kCell_m = 0.08, kReach_m = 0.16;
  static constexpr std::uint32_t kFrames = 3;

 private:
  // Frames are numbered modulo 2^32, which takes years, and begin shortly before the wrap: every run goes
  // through.
  static constexpr std::uint32_t kBegin = ~std::uint32_t{0} - 2, kNever = kBegin - kFrames - 1;
  struct Cell {
    std::int32_t x = 0, y = 0, z = 0;
    std::uint32_t frame = kNever;         // of the last mark
    std::uint32_t middle_frame = kNever;  // the last in which a mover's reading itself lay in here
    bool same_place(const Cell& other) const { return x == other.x && y == other.y && z == other.z; }
  };
  static constexpr std::size_t kBuckets = 4096;
  using Bucket = std::array<Cell, 4>;

  Cell cell_of(Vec3 p_map) const;
  static std::size_t bucket_of(const Cell& cell);
  void mark_around(const Cell& middle);
  Cell& marked(const Cell& cell);

  CameraModel camera_;
  const RayTable& rays_;
  std::span<Bucket> buckets_;
  /// Frames since then; right when the counter wraps, too.
  std::uint32_t age(std::uint32_t frame) const { return frame_ - frame; }

  std::uint32_t frame_ = kBegin;
  std::uint32_t last_marked_frame_ = kNever;
};

}  // namespace stillmap
