// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
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
/// in is then most likely the mover, and waits until the mover has gone on. A mover of which the detector is
/// not sure may as well be a surface that it takes for one now and then: nothing waits there, but it takes
/// more looks.
///
/// Cells of 8 cm in a fixed table, each with the frames of its last marks; where a bucket of the table is
/// full, the oldest mark gives way. One thread.
class MoverTrail {
 public:
  enum class Nearness : std::uint8_t { None, Unsure, Sure };

  /// `rays` must be of this camera and outlive the trail.
  MoverTrail(Arena& arena, const CameraModel& camera, const RayTable& rays);

  /// Goes one frame on, and marks the movers of `mask`, which belongs to the depth picture. Only silhouettes
  /// are marked: a box of the paper's rule takes in what is behind the mover. Movers whose boxes score
  /// `sure_score` or more are sure.
  void add_frame(ImageView<const std::uint16_t> depth, const DynamicMask& mask, float sure_score,
                 const Pose& T_map_camera_depth, double max_range_m);
  /// What mover was within kReach_m of the point in the newest frame or the kFrames before it.
  Nearness near(Vec3 p_map) const;

  static constexpr double kCell_m = 0.08, kReach_m = 0.16;
  static constexpr std::uint32_t kFrames = 3;

 private:
  // Frames are numbered modulo 2^32, which takes years, and begin shortly before the wrap: every run goes
  // through.
  static constexpr std::uint32_t kBegin = ~std::uint32_t{0} - 2, kNever = kBegin - kFrames - 1;
  struct Mark {
    std::uint32_t frame = kNever;         // the last in which a mover was near
    std::uint32_t middle_frame = kNever;  // the last in which a mover's reading itself lay in here
  };
  struct Cell {
    std::int32_t x = 0, y = 0, z = 0;
    Mark sure{}, unsure{};
    bool same_place(const Cell& other) const { return x == other.x && y == other.y && z == other.z; }
  };
  static constexpr std::size_t kBuckets = 4096;
  using Bucket = std::array<Cell, 4>;

  Cell cell_of(Vec3 p_map) const;
  static std::size_t bucket_of(const Cell& cell);
  void mark_around(const Cell& middle, Mark Cell::*which);
  /// The mark of a cell, set to this frame; the cell is made where there is none.
  Mark& marked(const Cell& cell, Mark Cell::*which);

  CameraModel camera_;
  const RayTable& rays_;
  std::span<Bucket> buckets_;
  /// Frames since then; right when the counter wraps, too.
  std::uint32_t age(std::uint32_t frame) const { return frame_ - frame; }
  std::uint32_t age(const Cell& cell) const { return std::min(age(cell.sure.frame), age(cell.unsure.frame)); }

  std::uint32_t frame_ = kBegin;
  std::uint32_t last_marked_frame_ = kNever;
};

}  // namespace stillmap
