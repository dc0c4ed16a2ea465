// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "stream/encoding.h"

namespace stillmap::stream {

/// The newest poses in both their encodings, made once for all clients; each client keeps its own place. A
/// second's worth, so that a client that is busy with a cloud still gets every pose. Stream thread.
class PoseHistory {
 public:
  static constexpr std::uint64_t kDepth = 32;
  struct Entry {
    Nanoseconds stamp_ns = 0;
    std::size_t transforms_bytes = 0, pose_bytes = 0;
    std::array<std::uint8_t, kMaxTransformsBytes> transforms{};
    std::array<std::uint8_t, kMaxPoseBytes> pose{};
  };

  void push(const StreamPose& pose) {
    Entry& entry = entries_[end_ % kDepth];
    entry.stamp_ns = pose.stamp_ns;
    entry.transforms_bytes = encode_transforms(pose, entry.transforms);
    entry.pose_bytes = encode_pose(pose, entry.pose);
    ++end_;
  }
  /// Poses so far; those from `end() - kDepth` on are kept.
  std::uint64_t end() const { return end_; }
  const Entry& at(std::uint64_t index) const { return entries_[index % kDepth]; }

 private:
  std::array<Entry, kDepth> entries_{};
  std::uint64_t end_ = 0;
};

}  // namespace stillmap::stream
