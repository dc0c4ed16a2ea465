// SPDX-License-Identifier: Apache-2.0
#include "runtime/track_stage.h"

#include "segment/segment.h"

namespace stillmap {

TrackStage::TrackStage(Arena& arena, const Config& config)
    : config_(config),
      carries_boxes_(config.track.has("carried_boxes")),
      tracker_(arena, config),
      copier_(arena),
      carrier_(config.camera, config.detector) {}

const Pose* TrackStage::pose_of(std::uint64_t sequence) const {
  const SequencePose& entry = recent_[static_cast<std::size_t>(sequence % recent_.size())];
  return entry.sequence == sequence ? &entry.T_odom_camera : nullptr;
}

void TrackStage::take_boxes(const Detections& boxes) {
  if (const Pose* pose = pose_of(boxes.sequence)) {
    carrier_.update(boxes, *pose);
  } else {
    pending_ = boxes;
    has_pending_ = true;
  }
}

const TrackingResult& TrackStage::step(const FrameSlot& frame) {
  const Pose predicted = tracker_.predict(frame.colour_ns);
  boxes_are_its_own_ = has_pending_ && pending_.sequence == frame.sequence;
  if (boxes_are_its_own_) carrier_.update(pending_, predicted);
  has_pending_ = false;
  if (!carries_boxes_ && !boxes_are_its_own_) carrier_.clear();
  carrier_.carry(frame.colour_ns, predicted, carried_);
  carried_.sequence = frame.sequence;
  segment(carried_, frame.depth, config_.camera, config_.track.dynamic_rule, mask_);
  (boxes_are_its_own_       ? box_supply_.fresh
   : carried_.items.empty() ? box_supply_.none
                            : box_supply_.carried) += 1;

  result_ = tracker_.track(frame, mask_);
  if (!result_.has_pose()) carrier_.clear();
  recent_[static_cast<std::size_t>(frame.sequence % recent_.size())] = {frame.sequence,
                                                                        result_.T_odom_camera};
  T_map_depth_ = result_.T_map_odom * tracker_.predict(frame.depth_ns);
  return result_;
}

void TrackStage::fill_posed(const FrameHandle& frame, PosedFrame& out) const {
  out.sequence = frame->sequence;
  out.stamp_ns = frame->colour_ns;
  out.frame = frame.share();
  out.T_map_colour = result_.T_map_camera();
  out.T_map_depth = T_map_depth_;
  out.reference_keyframe = result_.reference_keyframe;
  out.T_map_keyframe = result_.T_map_odom * tracker_.T_odom_reference_keyframe();
  out.epoch = result_.correction_epoch;
  out.boxes_are_its_own = boxes_are_its_own_;
  out.mask = mask_;
}

}  // namespace stillmap
