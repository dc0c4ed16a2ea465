// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <type_traits>

#include "core/fixed_vector.h"
#include "core/geometry.h"

namespace stillmap {

/// The tracker's word to the map that what was mapped so far belongs elsewhere: where its keyframes are now.
/// Absolute poses, so that a correction which is skipped takes nothing from the next. About 100 KB: filled
/// and read in place, never passed by value.
struct Correction {
  /// `track.keyframes` goes no higher.
  static constexpr std::size_t kMaxKeyframes = 1000;
  struct KeyframePose {
    std::uint32_t id = 0;
    Pose T_map_camera;  ///< at the keyframe's colour stamp
  };

  std::uint32_t epoch = 0;  ///< the `TrackingResult::correction_epoch` from which on it holds; counts from 1
  std::uint32_t segment_begin =
      0;  ///< the newest segment's first keyframe: those before need not move with it
  FixedVector<KeyframePose, kMaxKeyframes> keyframes;  ///< every one that the tracker holds, in any order
};
static_assert(std::is_trivially_copyable_v<Correction>);

}  // namespace stillmap
