// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "core/camera.h"
#include "core/frame_pool.h"

namespace stillmap {

/// What is wrong with a camera's depth, as far as its pictures alone show.
enum class DepthFault : std::uint8_t { None, Empty, Scale, Unregistered };

/// Looks at every tenth frame, a few thousand pixels of it, and after ten looks says whether the numbers
/// can be right: readings are there at all; most lie within the trusted range, as they do not where the
/// profile's depth units are wrong; and depth's edges lie on colour's. Looks on, and says each verdict anew.
/// One thread; nothing from the heap.
class DepthCheck {
 public:
  explicit DepthCheck(const CameraModel& camera) : camera_(camera) {}

  /// A verdict, with what it stands on, after each ten looks; otherwise None.
  struct Verdict {
    DepthFault fault = DepthFault::None;
    /// Empty: percent of pixels without a reading. Scale: percent of readings out of range. Unregistered: how
    /// many px right of depth's edges those of colour lie.
    int amount = 0;
  };
  Verdict look(const FrameSlot& frame);

 private:
  static constexpr int kMaxShift = 24;
  Verdict judge() const;
  void compare_edges(const std::uint16_t* depth, const Bgr* colour, int width);

  CameraModel camera_;
  std::uint64_t frames_ = 0, looks_ = 0;
  std::uint64_t pixels_ = 0, readings_ = 0, out_of_range_ = 0, edges_ = 0;
  std::array<std::uint64_t, 2 * kMaxShift + 1> contrast_{};  // of colour, at each shift from depth's edges
};

}  // namespace stillmap
