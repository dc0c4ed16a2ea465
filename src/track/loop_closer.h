// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "core/arena.h"
#include "core/camera.h"
#include "core/config.h"
#include "core/fixed_vector.h"
#include "core/random.h"
#include "track/local_map.h"
#include "track/place_index.h"
#include "track/view_matcher.h"

namespace stillmap {

/// Two keyframes that see the same place, and how they stand to each other.
struct LoopEdge {
  std::uint32_t keyframe_a = 0, keyframe_b = 0;  ///< ids; a is the newer one
  Pose T_a_b;
  /// Of T_a_b's left perturbation (rotation in rad, translation in m, in a's frame), row-major, as
  /// PoseGraphEdge has it.
  std::array<double, 36> information{};
  int inliers = 0;
};

/// What became of the questions, counted.
struct LoopCounts {
  std::uint64_t asked = 0, skipped = 0;  ///< skipped: asked while an earlier question was at work
  std::uint64_t compared = 0;            ///< pairs of keyframes
  std::uint64_t verified = 0;            ///< of those, geometry agreed
  std::uint64_t closed = 0;              ///< and the keyframe before said the same
};

/// Finds out whether the newest keyframe shows a place that the camera has seen before and is not tied to any
/// more: candidates from the place index, geometric verification of each, and two successive keyframes that
/// say the same. The same joins a segment that was begun after a loss to an older one.
///
/// `ask` once per keyframe, and `gather` once per frame; then, while `prepare` says that there is a pair to
/// compare, `compare` it, which may be another thread's, and `judge`. No heap after construction.
class LoopCloser {
 public:
  /// `places` has the keyframes by their slots, and must outlive this.
  LoopCloser(Arena& arena, const Config::Track& config, const CameraModel& camera, const PlaceIndex& places);

  /// Asks for keyframe `slot` of `map`; nothing happens while busy.
  void ask(const LocalMap& map, std::size_t slot);
  /// Looks for keyframes that resemble it, some of its features at a time: all take several ms. Keyframes of
  /// another segment, however new, are not tied to this one.
  void gather(const LocalMap& map);
  /// The newest sighting needs a second one to be believed, and this keyframe can still give it.
  bool awaits(std::uint32_t keyframe_id) const;
  bool busy() const { return gathering_ || next_ < candidates_.size(); }
  /// Copies the question's next pair of keyframes out of the map. False where none is left.
  bool prepare(const LocalMap& map, Random random);
  /// Some 30 million instructions. Looks at nothing but the copies.
  void compare();
  /// What the comparison says; a loop, once it is sure.
  std::optional<LoopEdge> judge(const LocalMap& map);
  const LoopCounts& counts() const { return counts_; }

 private:
  static constexpr std::size_t kCandidates = 3;
  struct KeyframeRef {
    std::size_t slot = 0;
    std::uint32_t id = 0;
  };
  struct Sighting {
    std::uint32_t a = 0, b = 0;  // ids
    Pose T_a_b, T_odom_a, T_odom_b;
  };
  static const Keyframe* find(const LocalMap& map, KeyframeRef ref);
  void mark_points(const Keyframe& keyframe);
  /// To the keyframe whose points are marked, by points that both see.
  bool is_tied(const Keyframe& keyframe) const;
  bool confirms(const Sighting& earlier, const Sighting& now) const;
  void end_question() {
    gathering_ = false;
    next_ = candidates_.size();
  }

  const PlaceIndex& places_;
  PlaceQuery query_;
  ViewMatcher matcher_;
  // What `compare` works on.
  std::span<Keyframe> pair_;
  Random random_{0};
  std::optional<ViewMatch> match_;

  std::span<std::uint32_t> marked_;  // ids of the asking keyframe's points, by slot
  KeyframeRef asking_;
  bool gathering_ = false;
  FixedVector<KeyframeRef, kCandidates> candidates_;
  std::size_t next_ = 0;              // candidate at work
  std::optional<Sighting> sighting_;  // the newest that geometry verified
  LoopCounts counts_;
};

}  // namespace stillmap
