// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/config.h"
#include "core/correction.h"
#include "core/image.h"
#include "map/block_fuser.h"
#include "map/block_table.h"
#include "map/keyframe_copies.h"
#include "map/keyframe_poses.h"

namespace stillmap {

/// Brings the map to where a correction says that it belongs, a bounded slice at a time:
///   1. At once: what hangs on a keyframe that moved, or is in the view of one that did, becomes old. From
///      here on frames are fused into current blocks only, at the new poses.
///   2. The kept copies say, at the poses that the blocks were made at, how much of each they show;
///      kTouchedAtOnce copies a slice.
///   3. Each copy is fused anew at its new pose, into blocks made since; one copy a slice.
///   4. An old block goes that the copies show at least a third of: it has been made anew. Any other moves
///      rigidly with its anchor keyframe: its voxels go where the copies and the frames since have seen
///      nothing. kMovedAtOnce blocks a slice.
/// Until its turn, an old block shows where it was. A correction during all this starts again, with what is
/// old already. One thread; no heap after construction.
class MapCorrector {
 public:
  static constexpr int kMovedAtOnce = 48, kTouchedAtOnce = 4;  // each about as long as fusing one copy

  /// `table` must outlive the corrector.
  MapCorrector(Arena& arena, const Config::Map& config, const CameraModel& camera, BlockTable& table);

  /// A fused frame; the first under each keyframe is copied. `z_m` as MeasuredDepth has it.
  struct Fused {
    std::uint32_t keyframe = 0;
    Pose T_map_keyframe, T_map_camera_depth, T_map_camera_colour;
    std::span<const float> z_m;
    ImageView<const Bgr> colour;
    std::uint64_t sequence = 0;
  };
  void note(const Fused& frame);
  void learn(std::uint32_t keyframe, const Pose& T_map_keyframe) { poses_.learn(keyframe, T_map_keyframe); }

  /// False where nothing moves.
  bool correct(const Correction& correction);
  /// The epoch of the newest correction.
  std::uint32_t epoch() const { return epoch_; }
  /// The epoch of the newest correction that all blocks follow.
  std::uint32_t settled_epoch() const { return settled_epoch_; }
  /// How the newest correction moves what hangs on keyframes.
  const KeyframeMotions& motions() const { return poses_.motions(); }
  /// Where the map has a keyframe in this epoch; null where it does not know it.
  const Pose* keyframe(std::uint32_t id) const { return poses_.find(id); }

  bool busy() const { return phase_ != Phase::Done; }
  /// The next slice. `frame_mark` as the fuser has it, not used for another frame.
  void step(std::uint16_t frame_mark);

 private:
  enum class Phase : std::uint8_t { Done, Touch, Fuse, Move };

  void work(std::uint16_t frame_mark);
  void make_old_what_moves();
  void begin(Phase phase);
  void move_copies();
  /// Calls `visit(pixel, voxel that its point lies in)` for each mapped pixel of a copy.
  template <class Visitor>
  void for_each_point(const KeyframeCopies::Copy& copy, Visitor&& visit) const;
  void touch_blocks(const KeyframeCopies::Copy& copy);
  void fuse_copy(const KeyframeCopies::Copy& copy, std::uint16_t frame_mark);
  void mark_points(const KeyframeCopies::Copy& copy, std::uint16_t frame_mark);
  /// The block at `at`, when it was made since the correction, or kNone; nothing is in the way where `at` has
  /// an old block or none.
  int block_since(BlockCoordinates at, std::uint32_t anchor_keyframe);
  void move_block(int index);

  double voxel_m_, max_range_m_;
  BlockTable& table_;
  KeyframePoses poses_;
  KeyframeCopies copies_;
  RayTable rays_;  // of the copies' camera
  BlockFuser fuser_;
  std::span<float> z_m_;        // of the copy at work
  std::span<float> shown_m2_;   // by block index: the area that copies show of those that are old
  BlockCoordinates camera_at_;  // of the newest frame
  std::uint64_t sequence_ = 0;  // of the newest frame
  std::uint32_t epoch_ = 0, settled_epoch_ = 0;
  std::uint32_t since_epoch_ = 0;  // copies go into blocks made in it or later
  Phase phase_ = Phase::Done;
  std::size_t next_copy_ = 0;
  int next_block_ = 0;
};

}  // namespace stillmap
