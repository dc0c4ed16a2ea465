// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "core/arena.h"
#include "core/correction.h"

namespace stillmap {

/// How a correction moves what hangs on keyframes.
struct KeyframeMotions {
  struct Motion {
    std::uint32_t id = 0;
    bool moved = false;
    Pose T_new_old;
  };
  /// T_new_old of what hangs on keyframe `id`; nothing where it stays. A keyframe that the correction does
  /// not name moves between its neighbours in time of the same segment.
  std::optional<Pose> motion_of(std::uint32_t id) const;

  std::uint32_t epoch = 0, segment_begin = 0;
  FixedVector<Motion, Correction::kMaxKeyframes> keyframes;  ///< ascending ids
};

/// Where the map has its keyframes, and how a correction moves what hangs on them. Of the newest kKept
/// keyframes; what hangs on an older one moves as the oldest known does. One thread; no heap after
/// construction.
class KeyframePoses {
 public:
  static constexpr std::size_t kKept = 2048;
  explicit KeyframePoses(Arena& arena);

  /// The pose at which the map first has a keyframe; later ones of the same id change nothing.
  void learn(std::uint32_t id, const Pose& T_map_keyframe);
  /// Null where the keyframe is not known.
  const Pose* find(std::uint32_t id) const;

  /// Takes a correction over. False, and nothing moved, where no keyframe went farther than `tolerance_m`;
  /// such small steps add up until they count.
  bool correct(const Correction& correction, double tolerance_m);
  /// Of the newest correction.
  const KeyframeMotions& motions() const { return motions_.front(); }
  std::optional<Pose> motion_of(std::uint32_t id) const { return motions().motion_of(id); }

 private:
  struct Entry {
    bool known = false;
    std::uint32_t id = 0;
    Pose T_map_keyframe;
  };
  std::span<Entry> entries_;            // by id modulo size
  std::span<KeyframeMotions> motions_;  // one
};

}  // namespace stillmap
