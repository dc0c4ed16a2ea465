// SPDX-License-Identifier: Apache-2.0
#include "runtime/final_trajectory.h"

#include <algorithm>

namespace stillmap {

void FinalTrajectory::note(const TrackingResult& result, const Pose& T_odom_keyframe) {
  if (poses_.capacity() == 0) return;
  if (keyframes_.empty() || keyframes_[keyframes_.size() - 1].id != result.reference_keyframe)
    static_cast<void>(
        keyframes_.try_push_back({result.reference_keyframe, result.T_map_odom * T_odom_keyframe}));
  static_cast<void>(poses_.try_push_back({result.stamp_ns, static_cast<std::uint32_t>(keyframes_.size() - 1),
                                          inverse(T_odom_keyframe) * result.T_odom_camera}));
}

void FinalTrajectory::correct(const Correction& correction) {
  Pose T_now_before;  // of the nearest one before that is still known
  bool any = false;
  std::size_t begin = 0;  // of the segment
  for (std::size_t i = 0; i < keyframes_.size(); ++i) {
    Correction::KeyframePose& keyframe = keyframes_[i];
    if (any && keyframe.id >= correction.segment_begin && keyframes_[begin].id < correction.segment_begin) {
      begin = i;
      any = false;
    }
    const auto known = std::find_if(correction.keyframes.begin(), correction.keyframes.end(),
                                    [&](const auto& k) { return k.id == keyframe.id; });
    if (known != correction.keyframes.end()) {
      T_now_before = known->T_map_camera * inverse(keyframe.T_map_camera);
      for (std::size_t w = any ? i : begin; w < i; ++w)  // those before the first that is known
        keyframes_[w].T_map_camera = T_now_before * keyframes_[w].T_map_camera;
      any = true;
      keyframe.T_map_camera = known->T_map_camera;
    } else if (any) {
      keyframe.T_map_camera = T_now_before * keyframe.T_map_camera;
    }
  }
}

std::vector<StampedPose> FinalTrajectory::poses() const {
  std::vector<StampedPose> all;
  all.reserve(poses_.size());
  for (const Hung& pose : poses_)
    all.push_back({pose.stamp_ns, keyframes_[pose.keyframe].T_map_camera * pose.T_keyframe_camera});
  return all;
}

}  // namespace stillmap
