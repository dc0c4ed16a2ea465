// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/arena.h"
#include "core/camera.h"
#include "core/config.h"
#include "core/correction.h"
#include "core/dynamic_mask.h"
#include "core/geometry.h"
#include "core/image.h"
#include "map/block_fuser.h"
#include "map/block_table.h"
#include "map/free_space.h"
#include "map/map_corrector.h"
#include "map/measured_depth.h"
#include "map/mover_trail.h"
#include "map/voxel.h"

namespace stillmap {

/// One posed frame for the map. Nothing is owned: all of it must live through the call.
struct FuseInput {
  ImageView<const Bgr> colour;
  ImageView<const std::uint16_t>
      depth;                          ///< registered to colour, in the camera's depth units, 0 = no reading
  const DynamicMask& mask;            ///< of this frame
  float sure_score = 0;               ///< from which on a box of the mask surely is what it says
  Pose T_map_camera_depth;            ///< at the depth picture's stamp
  Pose T_map_camera_colour;           ///< at the colour picture's stamp
  std::uint32_t anchor_keyframe = 0;  ///< blocks made now are anchored to it
  Pose T_map_keyframe{};              ///< that keyframe's own pose
  std::uint64_t sequence = 0;
};

/// Anything but Fused leaves the map as it was.
enum class FuseOutcome : std::uint8_t {
  Fused,
  WrongSize,  ///< a picture is not of the camera's size
  WrongMask,  ///< the mask's cells do not cover the picture
  WrongPose,  ///< not finite, no rotation, or more than 1000 km from the origin
};

/// The map of everything that stands still: voxels in blocks, in memory fixed at start. One thread, the map's
/// own, calls all of it; other threads ask MapQueries. Nothing here takes memory from the heap after
/// construction.
class VoxelMap {
 public:
  /// The far end of the map: voxel coordinates stay well inside 32 bits at any voxel size that the
  /// configuration takes.
  static constexpr double kMaxDistance_m = 1e6;
  /// Of a view that shows more, this many blocks are fused, which bounds a frame's time: those with points of
  /// the frame first, since a camera that turns fast may not see them again. What is only seen through waits
  /// its turn; with 260 blocks it waits so long that what has gone fades too late.
  static constexpr std::size_t kMostBlocksFused = 280;

  /// `rays` must be of this camera and outlive the map, and so must `evicted`, which gets the blocks that
  /// give way; null: they are lost.
  VoxelMap(Arena& arena, const Config::Map& config, const CameraModel& camera, const RayTable& rays,
           EvictedBlocks* evicted = nullptr);

  FuseOutcome fuse(const FuseInput& input);
  /// Takes over another map's blocks, before the first frame: those nearest to a place of the map frame, m,
  /// where not all have room. Gives the indices of the rest; uses the heap.
  std::vector<int> load(const BlockTable& blocks, Vec3 around_m = {});
  /// Where a keyframe is that loaded blocks may hang on.
  void learn_keyframe(std::uint32_t id, const Pose& T_map_keyframe) { corrector_.learn(id, T_map_keyframe); }

  /// Takes a correction over; `continue_correction` then does the work, a slice of about 1 ms at a time, as
  /// long as `correcting`. See MapCorrector.
  void correct(const Correction& correction);
  /// False while where evicted blocks are kept has yet to follow the correction before.
  bool can_correct() const { return evicted_ == nullptr || evicted_->motions.room() != nullptr; }
  bool correcting() const { return corrector_.busy(); }
  void continue_correction() {
    if (correcting()) corrector_.step(next_mark());
  }
  /// The correction epoch that fused poses have to be of, and where its keyframes are (null: not known).
  std::uint32_t epoch() const { return corrector_.epoch(); }
  /// The newest correction that all of the map follows: behind `epoch` while `correcting`.
  std::uint32_t settled_epoch() const { return corrector_.settled_epoch(); }
  const Pose* keyframe(std::uint32_t id) const { return corrector_.keyframe(id); }

  /// What is known of a point of the map frame, m.
  Occupancy at(Vec3 p_map) const;

  template <class Visitor>
  void for_each_occupied(Visitor&& visit) const {
    stillmap::for_each_occupied(table_, config_.voxel_m, visit);
  }
  const BlockTable& blocks() const { return table_; }

  double voxel_m() const { return config_.voxel_m; }
  std::uint64_t occupied_voxels() const { return table_.occupied_voxels(); }
  std::uint64_t blocks_evicted() const { return table_.evicted(); }
  std::uint64_t fused_frames() const { return fused_frames_; }
  /// Depth readings that one voxel stands for (the seed paper's voxel filter has about 9:1): of each fused
  /// frame, its mapped readings (in range, not on a silhouette, not on a mover) over the distinct voxels that
  /// they lie in, as the rows tell that were gone through; the mean over all fused frames that had any. 0
  /// before the first.
  double point_reduction() const;
  PoolUsage usage() const { return table_.usage(); }

 private:
  FuseOutcome check(const FuseInput& input) const;
  void mark_points(const FuseInput& input, std::uint16_t frame_mark);
  void fuse_blocks(std::uint64_t sequence, std::uint16_t frame_mark);
  void place_row(int y, const Pose& T_map_camera);
  /// Neighbouring points of a picture row that lie in one voxel.
  struct Run {
    std::uint32_t first_px = 0, points_before = 0;
  };
  /// Of the row last placed: into `runs_`, with one more that says where the last one ends.
  std::size_t find_runs(int y);
  std::uint16_t next_mark();

  Config::Map config_;
  CameraModel camera_;
  const RayTable& rays_;
  /// Of so many picture rows the points of one are marked, of another each frame: the face of a voxel at the
  /// far end is at least two of these rows high.
  int row_step_;
  EvictedBlocks* evicted_;
  FreeSpace free_space_;
  BlockTable table_;
  MeasuredDepth measured_;
  MoverTrail trail_;
  BlockFuser fuser_;
  MapCorrector corrector_;
  // Of one picture row: the voxel that each pixel's point lies in, and 1 where it is not that of the pixel
  // before.
  std::span<std::int32_t> row_x_, row_y_, row_z_, row_begins_;
  std::span<Run> runs_;
  std::span<std::uint16_t> points_mark_;  // of each block: of the frame whose points it last held
  ArenaVector<int> with_points_;          // the blocks that hold points of this frame
  std::size_t next_with_points_ = 0;      // to begin with, modulo their number
  int next_block_ = 0;                    // of the others, to begin with
  std::uint64_t fused_frames_ = 0, reduced_frames_ = 0, marks_ = 0;
  double reduction_sum_ = 0;
};

}  // namespace stillmap
