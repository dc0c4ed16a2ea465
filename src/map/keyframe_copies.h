// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/geometry.h"
#include "core/image.h"

namespace stillmap {

/// Small copies of frames that were fused, one per keyframe: every 4th pixel each way of depth (as
/// MeasuredDepth has it, so that the mask is in it) and colour; from them a piece of the map can be made anew
/// at corrected poses. 96 KB each at 640x480. In fixed memory: when it is full, the copy goes whose view
/// another repeats best. One thread; no heap after construction.
class KeyframeCopies {
 public:
  static constexpr int kStep = 4;
  struct Copy {
    std::uint32_t keyframe = 0;
    Pose T_map_camera_depth, T_map_camera_colour;
    std::span<std::int16_t> z_mm;  ///< MeasuredDepth's z_m in mm
    std::span<Bgr> colour;
  };

  KeyframeCopies(Arena& arena, const CameraModel& camera, std::size_t copies);

  /// The camera that the copies' pixels are of.
  const CameraModel& camera() const { return small_; }
  /// The last one added, or another of the same keyframe.
  bool has(std::uint32_t keyframe) const;
  /// `z_m` and `colour` are of the whole picture.
  void add(std::uint32_t keyframe, const Pose& T_map_camera_depth, const Pose& T_map_camera_colour,
           std::span<const float> z_m, ImageView<const Bgr> colour);
  std::span<Copy> copies() { return copies_.first(used_); }
  std::span<const Copy> copies() const { return copies_.first(used_); }
  PoolUsage usage() const { return {"map_keyframe_copies", copies_.size(), used_, replaced_}; }

 private:
  std::size_t least_missed() const;

  CameraModel small_;
  std::size_t width_ = 0;  // of the whole picture
  std::span<Copy> copies_;
  std::size_t used_ = 0;
  std::uint64_t replaced_ = 0;
};

}  // namespace stillmap
