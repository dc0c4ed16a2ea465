// SPDX-License-Identifier: Apache-2.0
#include "runtime/checkpoint.h"

#include <spdlog/spdlog.h>

#include <limits>
#include <utility>

#include "runtime/saved_map.h"

namespace stillmap {

Checkpoint::Checkpoint(const Config& config, std::string path, EarlierFile& earlier, MapStage& map,
                       KeyframeCopier& keyframes)
    : path_(std::move(path)),
      earlier_(earlier),
      facts_(map_facts(config)),
      every_ns_(is_map_file(path_) ? static_cast<Nanoseconds>(config.map.checkpoint_s * 1e9) : 0),
      blocks_(map.copier()),
      kept_(map.kept()),
      keyframes_(keyframes) {}

void Checkpoint::tick(Nanoseconds now) {
  keep_evicted();
  if (every_ns_ == 0) return;
  if (last_ns_ == 0) last_ns_ = now;
  if (writer_) {
    write_ready();
  } else if (now - last_ns_ >= every_ns_) {
    last_ns_ = now;
    writer_.emplace(path_, facts_, std::numeric_limits<Nanoseconds>::max(), &earlier_);
    blocks_done_ = false;
    blocks_.begin();
  }
}

void Checkpoint::keep_evicted() {
  kept_.take_all();
  if (kept_.status().ok() || loss_said_) return;
  loss_said_ = true;
  spdlog::warn("{}", kept_.status().error().message);
}

void Checkpoint::write_ready() {
  if (!blocks_done_) {
    const MapCopier::Part part = blocks_.ready();
    for (const CopiedBlock& copy : part.items) writer_->append(copy.block, copy.voxels);
    blocks_done_ = part.last;
    blocks_.next();
    if (!blocks_done_) return;
    kept_.take_all();  // with what gave way before its turn to be copied
    kept_.append_to(*writer_);
    keyframes_.begin();
    return;
  }
  const KeyframeCopier::Part part = keyframes_.ready();
  writer_->append_keyframes(part.items);
  const bool last = part.last;
  keyframes_.next();
  if (!last) return;
  if (Status s = writer_->finish(); !s.ok()) spdlog::warn("checkpoint: {}", s.error().message);
  writer_.reset();
}

}  // namespace stillmap
