// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "core/correction.h"
#include "core/mailbox.h"
#include "map/kept_blocks.h"
#include "map/map_copier.h"
#include "map/mover_sightings.h"
#include "map/voxel_map.h"
#include "runtime/latency.h"
#include "runtime/track_stage.h"
#include "stream/stream_server.h"

namespace stillmap {

/// A frame with the detector's word on it.
struct DetectedFrame {
  FrameHandle frame;
  Detections boxes;
};

/// What the map fused, by where its mask came from; `unposed`: the detector's frames that never got a pose.
struct FuseCounts {
  std::uint64_t own_boxes = 0, carried_boxes = 0, unposed = 0;
};

/// Posed frames and boxes in, voxels out. Frames are fused that the detector has seen, with their own boxes,
/// as far as MoverSightings lets them count; where it has said nothing for `detector.max_age_ms`, or there is
/// none, frames are fused with the tracker's mask. Knows no threads.
class MapStage {
 public:
  /// `kept_blocks`: how many evicted blocks are kept for the map file.
  MapStage(Arena& arena, const Config& config, const RayTable& rays, bool has_detector,
           std::size_t kept_blocks = 0);

  /// Before the first frame: takes over a map's blocks, and where the keyframes are that they hang on. Where
  /// the table has too little room, it has those around the newest keyframe, and the others are kept as
  /// evicted ones are. False where there is too little room for that, too.
  bool resume(const BlockTable& blocks, std::span<const Keyframe> keyframes);

  /// The tracker's thread posts a correction here before the first posed frame of its epoch: the map takes it
  /// with that frame.
  Mailbox<Correction>& corrections() { return corrections_.front(); }

  /// Also does a slice of what a correction has left to do.
  void take_frame(PosedFrame&& posed);
  /// After the frame itself came by `take_frame`.
  void take_detected(DetectedFrame&& detected);
  /// Fuses only every `factor`-th of the frames that map.fuse_every lets through.
  void set_fuse_factor(int factor) { fuse_factor_ = factor; }
  /// Hands the stream a new cloud when it wants one and the map has changed.
  void answer_cloud_request(StreamServer& server);

  /// Copies a bounded number of blocks for a checkpoint that waits for them.
  void serve_checkpoint() { copier_.serve(map_.blocks()); }

  /// All that a correction has left to do, some hundred ms at most; when the map's thread has ended.
  void finish_correction() {
    for (kept_.take_all(); map_.correcting(); kept_.take_all()) map_.continue_correction();
  }

  const VoxelMap& map() const { return map_; }
  MapCopier& copier() { return copier_; }
  /// Evicted blocks; the health thread's.
  KeptBlocks& kept() { return kept_; }
  const KeptBlocks& kept() const { return kept_; }
  /// The newest frame's stamp; 0 before the first.
  Nanoseconds newest_ns() const { return newest_ns_; }
  const FuseCounts& counts() const { return counts_; }
  const LatencyHistogram& fuse_time() const { return fuse_time_; }
  /// The same in the thread's processor time: without what runs on its core meanwhile.
  const LatencyHistogram& fuse_cpu_time() const { return fuse_cpu_time_; }

 private:
  struct RecentPose {
    std::uint64_t sequence = ~std::uint64_t{0};
    Pose T_map_colour, T_map_depth;
    std::uint32_t reference_keyframe = 0, epoch = 0;
    Pose T_map_keyframe;
  };
  std::size_t slot_of(std::uint64_t sequence) const {
    return static_cast<std::size_t>(sequence % recent_.size());
  }
  void take_correction(std::uint32_t epoch);
  /// A pose of another epoch than the map's is taken to it with its keyframe.
  RecentPose in_map(const RecentPose& pose) const;
  /// The mask of a frame with its own boxes, less those that do not count.
  const DynamicMask& mask_of_counting(const PosedFrame& posed);
  void fuse(const FrameSlot& frame, const RecentPose& tracked, const DynamicMask& mask);
  bool due(std::uint64_t sequence) const;

  Config config_;
  KeptBlocks kept_;
  VoxelMap map_;
  MapCopier copier_;
  std::span<Mailbox<Correction>> corrections_;  // one
  bool has_detector_;
  int fuse_factor_ = 1;
  Nanoseconds last_boxes_ns_ = 0, newest_ns_ = 0;
  std::array<RecentPose, 64> recent_{};  // at slot_of their sequence
  MoverSightings sightings_;
  Detections boxes_;  // of the frame at work
  DynamicMask mask_;
  FuseCounts counts_;
  LatencyHistogram fuse_time_, fuse_cpu_time_;
  std::uint64_t last_fused_sequence_ = 0;
  std::uint64_t cloud_of_change_ = 0;  // the table's `changes()` when the newest cloud was made
  std::uint32_t cloud_of_epoch_ = 0;
};

}  // namespace stillmap
