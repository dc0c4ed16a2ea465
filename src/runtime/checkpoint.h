// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "core/config.h"
#include "map/map_file.h"
#include "runtime/map_stage.h"
#include "track/keyframe_copier.h"

namespace stillmap {

/// Keeps evicted blocks, and writes the map to its file every `map.checkpoint_s` while the run goes on, from
/// the blocks and then the keyframes that copiers hand over. The health thread's; uses the heap.
class Checkpoint {
 public:
  /// Writes nothing where `path` is no .stillmap file or the key is 0.
  Checkpoint(const Config& config, std::string path, EarlierFile& earlier, MapStage& map,
             KeyframeCopier& keyframes);
  void tick(Nanoseconds now);

 private:
  void keep_evicted();
  void write_ready();

  std::string path_;
  EarlierFile& earlier_;
  MapFacts facts_;
  Nanoseconds every_ns_;
  MapCopier& blocks_;
  KeptBlocks& kept_;
  KeyframeCopier& keyframes_;
  bool blocks_done_ = false, loss_said_ = false;
  Nanoseconds last_ns_ = 0;
  std::optional<MapFileWriter> writer_;
};

}  // namespace stillmap
