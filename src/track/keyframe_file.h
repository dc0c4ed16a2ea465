// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

#include "core/arena.h"
#include "core/status.h"
#include "track/local_map.h"

namespace stillmap {

/// The local map as bytes, in pieces that each fit a small buffer. Flat, little endian, places in the map
/// frame: for each keyframe or point a record of a fixed head and, after a keyframe's, its features and their
/// descriptors. docs/map.md has the layout.
///
/// Writes the records of one local map, one after the other. The tracker's thread; no heap.
class KeyframeWriter {
 public:
  /// No record is larger.
  static constexpr std::size_t kLargestRecord = 68 << 10;

  void begin() { next_keyframe_ = next_point_ = 0; }
  /// Fills `out` (at least kLargestRecord) with whole records; returns how many bytes. Between two calls the
  /// map may change: a keyframe's reference to a point that has gone meanwhile leads nowhere when it is read.
  std::size_t write(const LocalMap& map, const Pose& T_map_odom, std::span<std::byte> out);
  bool done(const LocalMap& map) const {
    return next_keyframe_ == map.keyframes().size() && next_point_ == map.points().size();
  }

 private:
  std::size_t next_keyframe_ = 0, next_point_ = 0;
};

/// Puts what a KeyframeWriter wrote into an empty local map, whose odom frame is then the written map frame.
/// The error (UnreadableInput, without the file's name): the bytes are no such records; or (WrongConfig) the
/// map has too little room, with the keys to raise. Then the map is empty.
Status read_keyframes(std::span<const std::byte> bytes, LocalMap& map);

/// How many keyframes and points there are; the same error.
struct KeyframeCounts {
  std::size_t keyframes = 0, points = 0;
};
Result<KeyframeCounts> count_keyframes(std::span<const std::byte> bytes);

}  // namespace stillmap
