// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "core/camera.h"
#include "core/geometry.h"
#include "core/image.h"
#include "map/depth_horizon.h"
#include "map/lens.h"
#include "map/mover_trail.h"
#include "map/voxel.h"

namespace stillmap {

/// Projective fusion of one frame into the blocks that it sees: each voxel's centre is projected into the
/// depth picture and compared with what was measured there; never a ray per pixel. One thread.
///
/// With d = (voxel's depth) - (measured depth) and the truncation t = max(1 voxel, 1.5 sigma of the depth
/// noise):
///   enough measured points lie in the voxel, or |d| <= t / 2: evidence for occupied, and the colour there;
///   otherwise, d < -t: seen through, evidence for free;
///   otherwise nothing: behind a surface, or too near it to be sure.
/// Where a sure mover has just been, nothing becomes occupied that was not; what is seen there counts up to
/// the brink of it, so that one look after the mover has gone on settles it. Where the mover was not sure, it
/// takes three looks instead of two.
///
/// Counting points serves surfaces seen at a grazing angle: a voxel that they cross can have its centre far
/// before them along the ray. Enough is 10 % of the pixels that the voxel's face would fill: fewer is the
/// tail of the noise, which would make far walls twice as thick.
class BlockFuser {
 public:
  struct Change {
    bool shown = false;  ///< occupied voxels appeared, disappeared or changed colour
    bool known = false;  ///< a voxel's occupancy changed
    int occupied = 0;    ///< by how many there are more occupied voxels; below 0: fewer
  };

  /// `trail` must outlive the fuser; null: movers leave none. Each picture counts for `looks`.
  BlockFuser(Arena& arena, const CameraModel& camera, const RayTable& rays, const MoverTrail* trail,
             double voxel_m, int looks = 1);

  /// `z_m` as MeasuredDepth has it, or empty where only `in_view` is asked; `frame_mark` is what
  /// Voxel::last_hit holds where a point of this frame lies.
  void begin_frame(const Pose& T_map_camera_depth, const Pose& T_map_camera_colour,
                   std::span<const float> z_m, ImageView<const Bgr> colour, double max_range_m,
                   std::uint16_t frame_mark);
  bool in_view(BlockCoordinates at) const;
  /// Whether the frame may say anything of a block: not where all that was measured around it lies before it.
  bool may_tell(BlockCoordinates at) const;
  Change fuse(BlockCoordinates at, std::span<Voxel, kBlockVoxels> voxels) const;

 private:
  /// What the depth at its pixel says of each voxel of a row: 0 is nothing.
  static constexpr int kFree = 1, kOccupied = 2;
  using EvidenceRow = std::array<int, kBlockEdge>;
  using Point = std::array<float, 3>;  // of the depth camera's frame, m

  Vec3 first_centre_in_map(BlockCoordinates at) const;
  struct Ball {
    Point middle;  // of the depth camera's frame, m
    float radius_m;
  };
  /// Around the centres of a block's voxels.
  Ball ball_around(BlockCoordinates at) const;
  bool sees(const Ball& ball) const;
  float truncation_m(float z_m) const {
    return std::max(least_truncation_m_, truncation_m_at_1m_ * z_m * z_m);
  }
  /// The row of voxels whose first centre is at `begin_map` in the map, at `begin` in the depth camera.
  void fuse_row(Vec3 begin_map, const Point& begin, const Point& step, Voxel* voxels, Change& change) const;
  /// Of voxels whose depths begin at `begin_m`, `step_m` apart.
  EvidenceRow evidence_of(const Lens::PixelRow& pixels, float begin_m, float step_m) const;
  /// Whether enough points of this frame lie in a voxel at this depth.
  bool holds_points(const Voxel& voxel, float depth_m) const;
  /// The colour picture's pixel at a point; null where it is outside.
  const Bgr* colour_at(const Point& p_depth) const;
  /// What a hit adds to a voxel's log-odds, and how high it takes them at most.
  struct Worth {
    int step = Voxel::kHit, most = Voxel::kMax;
  };
  Worth worth_of(const Voxel& voxel, Vec3 p_map) const;
  // Both return whether what the voxel shows changed.
  bool hit(Voxel& voxel, const Bgr& colour, Worth worth) const;
  bool miss(Voxel& voxel) const;

  Lens lens_;
  DepthHorizon horizon_;
  const MoverTrail* trail_;
  int looks_;
  double voxel_m_;
  float least_truncation_m_, truncation_m_at_1m_;
  float enough_points_at_1m_;
  int width_;

  Pose T_depth_map_;
  Pose T_colour_depth_;
  std::span<const float> z_m_;
  ImageView<const Bgr> colour_;
  float far_m_ = 0;
  std::uint16_t frame_mark_ = 0;
};

}  // namespace stillmap
