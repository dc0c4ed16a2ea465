// SPDX-License-Identifier: Apache-2.0
#include "runtime/checkpoint.h"

#include <spdlog/spdlog.h>

#include <utility>

namespace stillmap {

MapFacts map_facts(const Config& config) {
  // The map begins at the base, whose z axis points up.
  return {config.map.voxel_m, calibration_hash(config.camera), config.mount.T_base_camera.has_value()};
}

Checkpoint::Checkpoint(const Config& config, std::string path, MapCopier& copier)
    : path_(std::move(path)),
      facts_(map_facts(config)),
      every_ns_(is_map_file(path_) ? static_cast<Nanoseconds>(config.map.checkpoint_s * 1e9) : 0),
      copier_(copier) {}

void Checkpoint::tick(Nanoseconds now) {
  if (every_ns_ == 0) return;
  if (last_ns_ == 0) last_ns_ = now;
  if (writer_) {
    write_ready();
  } else if (now - last_ns_ >= every_ns_) {
    last_ns_ = now;
    writer_.emplace(path_, facts_);
    copier_.begin();
  }
}

void Checkpoint::write_ready() {
  const MapCopier::Copies copies = copier_.ready();
  for (const MapCopier::CopiedBlock& copy : copies.blocks) writer_->append(copy.block, copy.voxels);
  const bool last = copies.last;
  copier_.next();
  if (!last) return;
  if (Status s = writer_->finish(); !s.ok()) spdlog::warn("checkpoint: {}", s.error().message);
  writer_.reset();
}

}  // namespace stillmap
