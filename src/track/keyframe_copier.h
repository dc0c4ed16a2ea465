// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/copy_pass.h"
#include "track/keyframe_file.h"

namespace stillmap {

/// Hands the local map, as a KeyframeWriter writes it, to another thread while the tracker goes on, about one
/// keyframe a frame.
class KeyframeCopier : public CopyPass<std::byte> {
 public:
  explicit KeyframeCopier(Arena& arena)
      : CopyPass(arena.take<std::byte>("keyframe_copies", KeyframeWriter::kLargestRecord)) {}

  /// Tracker's thread, after each frame.
  void serve(const LocalMap& map, const Pose& T_map_odom) {
    CopyPass::serve([&](bool first, std::span<std::byte> out) -> Filled {
      if (first) writer_.begin();
      const std::size_t bytes = writer_.write(map, T_map_odom, out);
      return {bytes, writer_.done(map)};
    });
  }

 private:
  KeyframeWriter writer_;
};

}  // namespace stillmap
