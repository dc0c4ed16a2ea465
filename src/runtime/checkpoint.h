// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "core/config.h"
#include "map/map_copier.h"
#include "map/map_file.h"
#include "track/keyframe_copier.h"

namespace stillmap {

/// Writes the map to its file every `map.checkpoint_s` while the run goes on, from the blocks and then the
/// keyframes that copiers hand over. The health thread's; uses the heap.
class Checkpoint {
 public:
  /// Does nothing where `path` is no .stillmap file or the key is 0.
  Checkpoint(const Config& config, std::string path, EarlierFile& earlier, MapCopier& blocks,
             KeyframeCopier& keyframes);
  void tick(Nanoseconds now);

 private:
  void write_ready();

  std::string path_;
  EarlierFile& earlier_;
  MapFacts facts_;
  Nanoseconds every_ns_;
  MapCopier& blocks_;
  KeyframeCopier& keyframes_;
  bool blocks_done_ = false;
  Nanoseconds last_ns_ = 0;
  std::optional<MapFileWriter> writer_;
};

}  // namespace stillmap
