// SPDX-License-Identifier: Apache-2.0
#include "map/map_corrector.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "map/landing.h"

namespace stillmap {

namespace {

/// A copy stands for the few frames that were fused under its keyframe.
constexpr int kLooksOfACopy = 2;
/// Less than this, in voxels, is no motion.
constexpr double kTolerance = 0.5;
/// The share of a block's surface that copies must show for it to be made anew from them.
constexpr double kShown = 1.0 / 3;

}  // namespace

MapCorrector::MapCorrector(Arena& arena, const Config::Map& config, const CameraModel& camera,
                           BlockTable& table)
    : voxel_m_(config.voxel_m),
      max_range_m_(config.max_range_m),
      table_(table),
      poses_(arena),
      copies_(arena, camera, static_cast<std::size_t>(config.keyframe_copies)),
      rays_(arena, copies_.camera()),
      fuser_(arena, copies_.camera(), rays_, nullptr, config.voxel_m, kLooksOfACopy),
      z_m_(arena.take<float>("map_keyframe_depth", static_cast<std::size_t>(copies_.camera().width) *
                                                       static_cast<std::size_t>(copies_.camera().height))),
      shown_m2_(arena.take<float>("map_block_shown",
                                  static_cast<std::size_t>(config.capacity_voxels / kBlockVoxels))) {}

void MapCorrector::note(const Fused& frame) {
  sequence_ = frame.sequence;
  camera_at_ = block_of(voxel_at(1 / voxel_m_ * frame.T_map_camera_depth.t));
  poses_.learn(frame.keyframe, frame.T_map_keyframe);
  if (!busy() && !copies_.has(frame.keyframe)) {  // the work stands on those that there are
    copies_.add(frame.keyframe, frame.T_map_camera_depth, frame.T_map_camera_colour, frame.z_m, frame.colour);
  }
}

bool MapCorrector::correct(const Correction& correction) {
  epoch_ = correction.epoch;
  if (phase_ == Phase::Touch) move_copies();  // by the correction before
  if (!poses_.correct(correction, kTolerance * voxel_m_)) {
    if (phase_ == Phase::Touch) begin(Phase::Fuse);
    if (!busy()) settled_epoch_ = epoch_;
    return false;
  }
  make_old_what_moves();
  table_.begin_epoch(epoch_);
  if (!busy()) since_epoch_ = epoch_;
  begin(Phase::Touch);
  return true;
}

void MapCorrector::begin(Phase phase) {
  phase_ = phase;
  next_copy_ = 0;
  next_block_ = 0;
}

void MapCorrector::move_copies() {
  for (KeyframeCopies::Copy& copy : copies_.copies()) {
    const std::optional<Pose> motion = poses_.motion_of(copy.keyframe);
    if (!motion) continue;
    copy.T_map_camera_depth = *motion * copy.T_map_camera_depth;
    copy.T_map_camera_colour = *motion * copy.T_map_camera_colour;
  }
}

void MapCorrector::make_old_what_moves() {
  std::uint32_t keyframe = 0;
  std::optional<Pose> motion = poses_.motion_of(keyframe);
  for (int i = 0; i < table_.size(); ++i) {
    const Block& block = table_.block(i);
    // Neighbours in memory mostly hang on the same keyframe.
    if (block.anchor_keyframe != keyframe) motion = poses_.motion_of(keyframe = block.anchor_keyframe);
    Pose& T_new_old = table_.T_new_old(i);
    if (block.state == BlockState::Current) {
      T_new_old = motion.value_or(Pose{});
      shown_m2_[static_cast<std::size_t>(i)] = 0;
      if (motion) table_.make_old(i);
    } else if (motion) {
      T_new_old = *motion * T_new_old;
    }
  }
  for (const KeyframeCopies::Copy& copy : copies_.copies()) {
    if (!poses_.motion_of(copy.keyframe)) continue;
    fuser_.begin_frame(copy.T_map_camera_depth, copy.T_map_camera_colour, {}, {}, max_range_m_, 0);
    for (int i = 0; i < table_.size(); ++i) {
      const Block& block = table_.block(i);
      if (block.state == BlockState::Current && fuser_.in_view(block.at)) table_.make_old(i);
    }
  }
}

void MapCorrector::step(std::uint16_t frame_mark) {
  work(frame_mark);
  if (!busy()) settled_epoch_ = epoch_;
}

void MapCorrector::work(std::uint16_t frame_mark) {
  if (table_.evicted_wait()) return;  // what a slice makes give way has room then
  const std::span<const KeyframeCopies::Copy> copies = copies_.copies();
  table_.begin_frame(camera_at_);
  switch (phase_) {
    case Phase::Done:
      return;
    case Phase::Touch:
      for (int i = 0; i < kTouchedAtOnce && next_copy_ < copies.size(); ++i)
        touch_blocks(copies[next_copy_++]);
      if (next_copy_ < copies.size()) return;
      move_copies();
      return begin(Phase::Fuse);
    case Phase::Fuse:
      if (next_copy_ == copies.size()) return begin(Phase::Move);
      return fuse_copy(copies[next_copy_++], frame_mark);
    case Phase::Move:
      for (int moved = 0; moved < kMovedAtOnce && next_block_ < table_.size(); ++next_block_) {
        if (table_.block(next_block_).state != BlockState::Old) continue;
        move_block(next_block_);
        ++moved;
      }
      if (next_block_ >= table_.size()) phase_ = Phase::Done;
  }
}

template <class Visitor>
void MapCorrector::for_each_point(const KeyframeCopies::Copy& copy, Visitor&& visit) const {
  const CameraModel& camera = copies_.camera();
  Pose T = copy.T_map_camera_depth;  // to voxels
  for (double& m : T.R.m) m /= voxel_m_;
  T.t = 1 / voxel_m_ * T.t;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const std::int16_t z_mm = copy.z_mm[static_cast<std::size_t>(y * camera.width + x)];
      if (z_mm <= 0) continue;
      const RayTable::Ray ray = rays_.at(x, y);
      const double z = 1e-3 * z_mm;
      visit(z, voxel_at(T * Vec3{ray.x * z, ray.y * z, z}));
    }
  }
}

void MapCorrector::touch_blocks(const KeyframeCopies::Copy& copy) {
  const CameraModel& camera = copies_.camera();
  const double pixel_m2_at_1m = 1 / (camera.fx * camera.fy);
  for_each_point(copy, [&](double z, VoxelCoordinates v) {
    const int index = table_.find(block_of(v));
    if (index != BlockTable::kNone)
      shown_m2_[static_cast<std::size_t>(index)] += static_cast<float>(pixel_m2_at_1m * z * z);
  });
}

void MapCorrector::fuse_copy(const KeyframeCopies::Copy& copy, std::uint16_t frame_mark) {
  std::ranges::transform(copy.z_mm, z_m_.begin(),
                         [](std::int16_t mm) { return 1e-3f * static_cast<float>(mm); });
  mark_points(copy, frame_mark);
  const CameraModel& camera = copies_.camera();
  fuser_.begin_frame(copy.T_map_camera_depth, copy.T_map_camera_colour, z_m_,
                     {copy.colour.data(), camera.width, camera.height, camera.width}, max_range_m_,
                     frame_mark);
  for (int i = 0; i < table_.size(); ++i) {
    const Block& block = table_.block(i);
    if (block.state != BlockState::Current || block.made_epoch < since_epoch_ || !fuser_.may_tell(block.at))
      continue;
    const BlockFuser::Change change = fuser_.fuse(block.at, table_.voxels(i));
    table_.note_fused(i, sequence_, change.shown, block.occupied + change.occupied);
    if (change.known) table_.publish(i);
  }
}

void MapCorrector::mark_points(const KeyframeCopies::Copy& copy, std::uint16_t frame_mark) {
  BlockCoordinates at;
  int index = BlockTable::kNone;
  bool have_block = false;
  for_each_point(copy, [&](double, VoxelCoordinates v) {
    const BlockCoordinates around = block_of(v);
    if (!have_block || !(around == at)) {
      at = around;
      have_block = true;
      index = block_since(at, copy.keyframe);
    }
    if (index == BlockTable::kNone) return;
    Voxel& voxel = table_.voxels(index)[place_in_block(v)];
    if (voxel.last_hit != frame_mark) {
      voxel.last_hit = frame_mark;
      voxel.points = 0;
    }
    voxel.points = static_cast<std::uint8_t>(voxel.points + (voxel.points < 255));
  });
}

int MapCorrector::block_since(BlockCoordinates at, std::uint32_t anchor_keyframe) {
  const int there = table_.find(at);
  if (there != BlockTable::kNone && table_.block(there).state == BlockState::Current)
    return table_.block(there).made_epoch >= since_epoch_ ? there : BlockTable::kNone;
  return table_.find_or_add(at, anchor_keyframe);
}

void MapCorrector::move_block(int index) {
  const Block block = table_.block(index);
  const double surface_m2 = block.occupied * voxel_m_ * voxel_m_;
  const bool made_anew =
      block.occupied > 0 &&
      static_cast<double>(shown_m2_[static_cast<std::size_t>(index)]) > kShown * surface_m2;
  std::array<Voxel, kBlockVoxels> voxels;
  std::ranges::copy(table_.voxels(index), voxels.begin());
  const Pose T_new_old = table_.T_new_old(index);
  bool refused = false;
  table_.release(index);  // first: what it becomes needs room
  if (made_anew) return;
  const Pose to_voxels{T_new_old.R, 1 / voxel_m_ * T_new_old.t};
  for_each_landing(block.at, to_voxels, [&](std::size_t from, VoxelCoordinates to) {
    if (voxels[from].log_odds == 0) return;
    const int there = table_.find_or_add(block_of(to), block.anchor_keyframe);
    refused |= there == BlockTable::kNone;
    if (there == BlockTable::kNone) return;
    Voxel& voxel = table_.voxels(there)[place_in_block(to)];
    if (voxel.log_odds != 0) return;
    voxel = voxels[from];
    voxel.last_hit = 0;  // of another place
    table_.publish(there, place_in_block(to));
    if (voxel.occupied())
      table_.note_fused(there, block.fused_sequence, true, table_.block(there).occupied + 1);
  });
  if (refused) static_cast<void>(table_.give_away(block, voxels, T_new_old));
}

}  // namespace stillmap
