// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "core/arena.h"
#include "track/loop_closer.h"
#include "track/loop_correction.h"
#include "track/place_index.h"
#include "track/turns.h"

namespace stillmap {

/// From a keyframe to a mended map: does it show a known place, and if so, where must what lies between be?
/// The tracker asks and takes the answers; a worker compares pictures and solves, beside it. No heap after
/// construction.
class LoopClosing {
 public:
  /// `places` has the map's keyframes by their slots, and must outlive this.
  LoopClosing(Arena& arena, const Config::Track& config, const CameraModel& camera, const PlaceIndex& places)
      : closer_(arena, config, camera, places),
        correction_(arena, static_cast<std::size_t>(config.keyframes),
                    static_cast<std::size_t>(config.points)) {}

  /// The tracker's, after keyframe `slot` has been made. A question costs the worker some 30 ms, and a loop
  /// can wait: one is asked a second, and more only to confirm what the last one saw.
  void ask(const LocalMap& map, std::size_t slot) {
    const Keyframe& keyframe = map.keyframes()[slot];
    constexpr Nanoseconds kPause_ns = 1'000'000'000;
    const bool pausing = keyframe.stamp_ns - asked_ns_ < kPause_ns && keyframe.stamp_ns >= asked_ns_;
    if (correcting_ || closer_.busy() || (pausing && !closer_.awaits(keyframe.id))) return;
    asked_ns_ = keyframe.stamp_ns;
    closer_.ask(map, slot);
  }
  /// The tracker's, once a frame: takes what the worker has found, and gives it what comes next. When a loop
  /// has been closed, the map is mended, the segments that it joins are one, and what map -> odom is to be
  /// multiplied by from the right is returned.
  std::optional<Pose> step(LocalMap& map, Random random) {
    if (turns_.waits()) return std::nullopt;
    std::optional<Pose> moved;
    if (turns_.done()) {
      if (!correcting_) {
        const std::optional<LoopEdge> loop = closer_.judge(map);
        correcting_ = loop && is_off(map, *loop) && correction_.prepare(map, *loop);
      } else {
        correcting_ = false;
        moved = correction_.apply(map);
      }
      turns_.rest();
    }
    closer_.gather(map);
    if (correcting_ || closer_.prepare(map, random)) turns_.offer();
    return moved;
  }

  /// Any thread: there is work.
  bool waits() const { return turns_.waits(); }
  /// The worker's; nothing where none waits.
  void work() {
    if (!waits()) return;
    correcting_ ? correction_.solve() : closer_.compare();
    turns_.finish();
  }
  const LoopCounts& counts() const { return closer_.counts(); }

 private:
  /// A loop that tells little new is left alone: matching around the prediction bridges it, and a correction
  /// has an error of its own of some centimetres.
  static bool is_off(const LocalMap& map, const LoopEdge& loop) {
    constexpr double kOff_m = 0.08, kOff_rad = 0.04;
    const Keyframe *a = map.find_keyframe(loop.keyframe_a), *b = map.find_keyframe(loop.keyframe_b);
    if (a == nullptr || b == nullptr) return false;
    const Pose off = a->T_odom_camera * loop.T_a_b * inverse(b->T_odom_camera);
    return a->segment != b->segment || norm((off * b->T_odom_camera).t - b->T_odom_camera.t) > kOff_m ||
           norm(log_so3(off.R)) > kOff_rad;
  }
  Turns turns_;
  LoopCloser closer_;
  LoopCorrection correction_;
  bool correcting_ = false;   // written in the tracker's turn only
  Nanoseconds asked_ns_ = 0;  // stamp of the keyframe that was last asked for
};

}  // namespace stillmap
