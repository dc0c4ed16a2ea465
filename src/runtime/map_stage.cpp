// SPDX-License-Identifier: Apache-2.0
#include "runtime/map_stage.h"

#include <algorithm>

#include "map/cloud.h"
#include "runtime/capture.h"
#include "segment/segment.h"

namespace stillmap {

MapStage::MapStage(Arena& arena, const Config& config, const RayTable& rays, bool has_detector,
                   std::size_t kept_blocks)
    : config_(config),
      kept_(arena, kept_blocks, config.map.voxel_m),
      map_(arena, config.map, config.camera, rays, kept_.lane()),
      copier_(arena),
      corrections_(arena.take<Mailbox<Correction>>("correction", 1)),
      has_detector_(has_detector),
      sightings_(arena, config.camera, config.detector.confirm_score) {}

bool MapStage::resume(const BlockTable& blocks, std::span<const Keyframe> keyframes) {
  const Keyframe* newest = nullptr;
  for (const Keyframe& keyframe : keyframes) {
    if (!keyframe.alive) continue;
    map_.learn_keyframe(keyframe.id, keyframe.T_odom_camera);
    if (newest == nullptr || keyframe.id > newest->id) newest = &keyframe;
  }
  for (const int index : map_.load(blocks, newest == nullptr ? Vec3{} : newest->T_odom_camera.t)) {
    CopiedBlock block{blocks.block(index), {}};
    block.block.fused_sequence = block.block.changed_sequence = 0;  // before this run
    std::ranges::copy(blocks.voxels(index), block.voxels.begin());
    kept_.keep(block);
  }
  return kept_.usage().refused == 0;
}

bool MapStage::due(std::uint64_t sequence) const {
  return map_.fused_frames() == 0 ||
         sequence >= last_fused_sequence_ + static_cast<std::uint64_t>(config_.map.fuse_every * fuse_factor_);
}

void MapStage::take_correction(std::uint32_t epoch) {
  const Correction* correction = corrections().waiting();
  if (correction == nullptr || correction->epoch > epoch || !map_.can_correct()) return;
  map_.correct(*correction);
  corrections().taken();
}

MapStage::RecentPose MapStage::in_map(const RecentPose& pose) const {
  const Pose* keyframe = map_.keyframe(pose.reference_keyframe);
  if (pose.epoch == map_.epoch() || keyframe == nullptr) return pose;
  RecentPose brought = pose;
  const Pose T_now_then = *keyframe * inverse(pose.T_map_keyframe);
  brought.T_map_colour = T_now_then * pose.T_map_colour;
  brought.T_map_depth = T_now_then * pose.T_map_depth;
  brought.T_map_keyframe = *keyframe;
  brought.epoch = map_.epoch();
  return brought;
}

void MapStage::take_frame(PosedFrame&& posed) {
  take_correction(posed.epoch);
  map_.continue_correction();
  if (newest_ns_ == 0) last_boxes_ns_ = posed.stamp_ns;
  newest_ns_ = posed.stamp_ns;
  const RecentPose& pose =
      recent_[slot_of(posed.sequence)] = {posed.sequence,           posed.T_map_colour, posed.T_map_depth,
                                          posed.reference_keyframe, posed.epoch,        posed.T_map_keyframe};
  if (posed.boxes_are_its_own) last_boxes_ns_ = newest_ns_;
  const bool detector_silent =
      newest_ns_ - last_boxes_ns_ > static_cast<Nanoseconds>(config_.detector.max_age_ms) * 1'000'000;
  if (!posed.frame || (has_detector_ && !posed.boxes_are_its_own && !detector_silent))
    return;  // its own boxes are on their way
  const DynamicMask& mask = posed.boxes_are_its_own ? mask_of_counting(posed) : posed.mask;
  if (due(posed.sequence)) {
    fuse(*posed.frame, pose, mask);
    (posed.boxes_are_its_own ? counts_.own_boxes : counts_.carried_boxes) += 1;
  }
  posed.frame.reset();
}

const DynamicMask& MapStage::mask_of_counting(const PosedFrame& posed) {
  if (posed.mask.rule != DynamicRule::Silhouette) return posed.mask;
  boxes_ = posed.mask.boxes;
  if (!sightings_.filter(boxes_, posed.T_map_colour)) return posed.mask;
  segment(boxes_, posed.frame->depth, config_.camera, posed.mask.rule, mask_);
  return mask_;
}

void MapStage::take_detected(DetectedFrame&& detected) {
  const FrameSlot& frame = *detected.frame;
  last_boxes_ns_ = detected.boxes.stamp_ns;
  const RecentPose& pose = recent_[slot_of(frame.sequence)];
  if (pose.sequence != frame.sequence) {
    ++counts_.unposed;
    detected.frame.reset();
    return;
  }
  if (config_.track.dynamic_rule == DynamicRule::Silhouette)
    sightings_.filter(detected.boxes, in_map(pose).T_map_colour);
  if (due(frame.sequence)) {
    segment(detected.boxes, frame.depth, config_.camera, config_.track.dynamic_rule, mask_);
    fuse(frame, pose, mask_);
    ++counts_.own_boxes;
  }
  detected.frame.reset();
}

void MapStage::fuse(const FrameSlot& frame, const RecentPose& tracked, const DynamicMask& mask) {
  const Nanoseconds begin = monotonic_now(), cpu_begin = thread_cpu_now();
  const RecentPose pose = in_map(tracked);
  static_cast<void>(map_.fuse({.colour = frame.colour,
                               .depth = frame.depth,
                               .mask = mask,
                               .sure_score = sightings_.sure_score(),
                               .T_map_camera_depth = pose.T_map_depth,
                               .T_map_camera_colour = pose.T_map_colour,
                               .anchor_keyframe = pose.reference_keyframe,
                               .T_map_keyframe = pose.T_map_keyframe,
                               .sequence = frame.sequence}));
  last_fused_sequence_ = frame.sequence;
  fuse_time_.add(monotonic_now() - begin);
  fuse_cpu_time_.add(thread_cpu_now() - cpu_begin);
}

void MapStage::answer_cloud_request(StreamServer& server) {
  const std::uint64_t change = map_.blocks().changes();
  const std::uint32_t epoch = map_.settled_epoch();
  if ((change == cloud_of_change_ && epoch == cloud_of_epoch_) || !server.cloud_wanted()) return;
  const std::span<CloudPoint> room = server.begin_cloud();
  if (room.empty()) return;
  server.publish_cloud(make_cloud(map_, room), newest_ns_, epoch);
  cloud_of_change_ = change;
  cloud_of_epoch_ = epoch;
}

}  // namespace stillmap
