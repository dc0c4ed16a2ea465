// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

namespace stillmap {

// What waits between two threads. Live, a tracker or map that is further behind skips frames, and says so.
constexpr std::size_t kReadAheadRing = 1, kTrackRing = 2, kMapRing = 2, kDetectedRing = 1;

/// How many frames each part of the pipeline may hold at once. The pool is their sum, so capture starves only
/// by fault.
struct FrameBudget {
  struct Line {
    const char* who = "";
    std::size_t frames = 0;
  };
  std::array<Line, 6> lines;
  std::size_t sum() const {
    std::size_t total = 0;
    for (const Line& line : lines) total += line.frames;
    return total;
  }
};

/// Who takes part in a run, and how many frames those hold that are not threads of the frame's way.
struct FrameHolders {
  bool detector = false, log = false;
  std::size_t recorder = 0;
  /// How many frames lockstep's detector is late; it keeps them, and little else is held then.
  std::size_t lockstep_delay = 0;
};

constexpr FrameBudget frame_budget(const FrameHolders& holders) {
  const auto [detector, log, recorder, lockstep_delay] = holders;
  FrameBudget budget{{{
      // The one in hand, and a camera's spare that is being filled
      {"capture", log ? 1u : 2u},
      // Decoded ahead of their time, and the one that is being decoded or waits for room
      {"read-ahead", log ? kReadAheadRing + 1 : 0},
      {"tracker", kTrackRing + 1},       // its ring and the frame at work
      {"detector", detector ? 2u : 0u},  // waiting and at work
      // Its ring and the frame at work; or, while the detector speaks, those that it has seen
      {"map", std::max(kMapRing, kDetectedRing) + 1},
      {"recorder", recorder},
  }}};
  constexpr std::size_t kLockstepHolds = 4;  // the spare, one in hand, one at the tracker, one at the map
  std::size_t others = 0;
  for (const FrameBudget::Line& line : budget.lines) others += line.frames;
  const std::size_t late = kLockstepHolds + recorder + lockstep_delay;
  if (late > others) budget.lines[3].frames += late - others;
  return budget;
}

}  // namespace stillmap
