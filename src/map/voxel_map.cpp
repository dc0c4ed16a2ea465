// SPDX-License-Identifier: Apache-2.0
#include "map/voxel_map.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace stillmap {

namespace {

bool is_usable(const Pose& T) {
  if (!is_finite(T)) return false;
  const Mat3 identity = T.R * transposed(T.R);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      if (std::abs(identity(r, c) - (r == c ? 1 : 0)) > 1e-3) return false;
    }
  }
  return std::max({std::abs(T.t.x), std::abs(T.t.y), std::abs(T.t.z)}) <= VoxelMap::kMaxDistance_m;
}

bool covers(const DynamicMask& mask, int width, int height) {
  if (mask.rule != DynamicRule::Silhouette) return true;
  return mask.cell_px > 0 && mask.columns > 0 && mask.columns <= DynamicMask::kMaxColumns && mask.rows > 0 &&
         mask.rows <= DynamicMask::kMaxRows && mask.columns * mask.cell_px >= width &&
         mask.rows * mask.cell_px >= height;
}

std::size_t blocks_of(const Config::Map& config) {
  return static_cast<std::size_t>(config.capacity_voxels / kBlockVoxels);
}

}  // namespace

VoxelMap::VoxelMap(Arena& arena, const Config::Map& config, const CameraModel& camera, const RayTable& rays,
                   EvictedBlocks* evicted)
    : config_(config),
      camera_(camera),
      rays_(rays),
      row_step_(std::max(1, static_cast<int>(camera.fy * config.voxel_m / config.max_range_m / 2))),
      evicted_(evicted),
      free_space_(arena, camera, rays, config.voxel_m, config.max_range_m),
      table_(arena, blocks_of(config), &free_space_, evicted),
      measured_(arena, camera, config.max_range_m),
      trail_(arena, camera, rays),
      fuser_(arena, camera, rays, &trail_, config.voxel_m),
      corrector_(arena, config, camera, table_),
      row_x_(arena.take<std::int32_t>("map_row_x", static_cast<std::size_t>(camera.width))),
      row_y_(arena.take<std::int32_t>("map_row_y", static_cast<std::size_t>(camera.width))),
      row_z_(arena.take<std::int32_t>("map_row_z", static_cast<std::size_t>(camera.width))),
      row_begins_(arena.take<std::int32_t>("map_row_begins", static_cast<std::size_t>(camera.width))),
      runs_(arena.take<Run>("map_row_runs", static_cast<std::size_t>(camera.width) + 1)),
      points_mark_(arena.take<std::uint16_t>("map_points_mark", blocks_of(config))),
      with_points_(arena.take<int>("map_with_points", blocks_of(config))) {}

FuseOutcome VoxelMap::fuse(const FuseInput& input) {
  if (const FuseOutcome wrong = check(input); wrong != FuseOutcome::Fused) return wrong;
  ++fused_frames_;
  const std::uint16_t frame_mark = next_mark();
  measured_.prepare(input.depth, input.mask);
  trail_.add_frame(input.depth, input.mask, input.sure_score, input.T_map_camera_depth, config_.max_range_m);
  mark_points(input, frame_mark);
  fuser_.begin_frame(input.T_map_camera_depth, input.T_map_camera_colour, measured_.z_m(), input.colour,
                     config_.max_range_m, frame_mark);
  fuse_blocks(input.sequence, frame_mark);
  free_space_.see(input.T_map_camera_depth, measured_.z_m());
  corrector_.note({input.anchor_keyframe, input.T_map_keyframe, input.T_map_camera_depth,
                   input.T_map_camera_colour, measured_.z_m(), input.colour, input.sequence});
  return FuseOutcome::Fused;
}

void VoxelMap::fuse_blocks(std::uint64_t sequence, std::uint16_t frame_mark) {
  const auto fuse = [&](int i) {
    const Block& block = table_.block(i);
    const BlockFuser::Change change = fuser_.fuse(block.at, table_.voxels(i));
    table_.note_fused(i, sequence, change.shown, block.occupied + change.occupied);
    if (change.known) table_.publish(i);
  };
  const std::size_t points_in = with_points_.size(), first = std::min(points_in, kMostBlocksFused);
  for (std::size_t n = 0; n < first; ++n) fuse(with_points_[next_with_points_++ % points_in]);
  std::size_t room = kMostBlocksFused - first;
  for (int looked_at = 0, i = next_block_; looked_at < table_.size() && room > 0; ++looked_at, ++i) {
    if (i >= table_.size()) i = 0;
    const Block& block = table_.block(i);
    const bool done = points_mark_[static_cast<std::size_t>(i)] == frame_mark;
    if (done || block.state != BlockState::Current || !fuser_.may_tell(block.at)) continue;
    fuse(i);
    if (--room == 0) next_block_ = i + 1;
  }
}

void VoxelMap::correct(const Correction& correction) {
  if (!corrector_.correct(correction)) return;
  free_space_.clear();  // bits do not move: the air is seen anew
  if (evicted_ == nullptr) return;
  KeyframeMotions* room = evicted_->motions.room();
  STILLMAP_CHECK(room != nullptr);
  *room = corrector_.motions();
  evicted_->motions.post();
}

std::uint16_t VoxelMap::next_mark() {
  // 0 marks voxels without a point, so it is no frame's mark.
  return static_cast<std::uint16_t>(1 + marks_++ % 65535);
}

std::vector<int> VoxelMap::load(const BlockTable& blocks, Vec3 around_m) {
  const BlockCoordinates around = block_of(voxel_at(1 / config_.voxel_m * around_m));
  std::vector<int> nearest;
  for (int i = 0; i < blocks.size(); ++i) {
    if (blocks.found(i)) nearest.push_back(i);
  }
  const std::size_t fit = std::min(nearest.size(), static_cast<std::size_t>(table_.usage().capacity));
  if (fit < nearest.size()) {
    std::ranges::sort(nearest, {},
                      [&](int i) { return std::pair(distance2(blocks.block(i).at, around), i); });
  }
  for (const int i : std::span(nearest).first(fit)) {
    const Block& from = blocks.block(i);
    const int index = table_.find_or_add(from.at, from.anchor_keyframe);
    std::ranges::transform(blocks.voxels(i), table_.voxels(index).begin(), [](Voxel voxel) {
      voxel.last_hit = 0;  // no frame of this run
      return voxel;
    });
    table_.note_fused(index, 0, true, from.occupied);
    table_.publish(index);
  }
  nearest.erase(nearest.begin(), nearest.begin() + static_cast<std::ptrdiff_t>(fit));
  return nearest;
}

FuseOutcome VoxelMap::check(const FuseInput& input) const {
  const auto fits = [this](const auto& picture) {
    return picture.data != nullptr && picture.width == camera_.width && picture.height == camera_.height;
  };
  if (!fits(input.colour) || !fits(input.depth)) return FuseOutcome::WrongSize;
  if (!covers(input.mask, camera_.width, camera_.height)) return FuseOutcome::WrongMask;
  if (!is_usable(input.T_map_camera_depth) || !is_usable(input.T_map_camera_colour))
    return FuseOutcome::WrongPose;
  return FuseOutcome::Fused;
}

void VoxelMap::mark_points(const FuseInput& input, std::uint16_t frame_mark) {
  const Vec3 t = (1 / config_.voxel_m) * input.T_map_camera_depth.t;
  table_.begin_frame(block_of(voxel_at(t)));
  const auto step = static_cast<std::uint32_t>(row_step_);  // each row stands for its neighbours
  std::uint64_t points = 0, distinct = 0;
  BlockCoordinates at;
  int index = BlockTable::kNone;
  bool have_block = false;
  with_points_.clear();
  for (int y = static_cast<int>(fused_frames_ % static_cast<std::uint64_t>(row_step_)); y < camera_.height;
       y += row_step_) {
    place_row(y, input.T_map_camera_depth);
    const std::size_t runs = find_runs(y);
    for (std::size_t run = 0; run < runs; ++run) {
      const std::size_t x = runs_[run].first_px;
      const std::uint32_t here = step * (runs_[run + 1].points_before - runs_[run].points_before);
      // Neighbouring voxels mostly share a block: the table is asked only where it changes.
      const BlockCoordinates around = block_of(row_x_[x], row_y_[x], row_z_[x]);
      if (!have_block || !(around == at)) {
        at = around;
        have_block = true;
        index = table_.find_or_add(at, input.anchor_keyframe);
        if (index != BlockTable::kNone &&
            std::exchange(points_mark_[static_cast<std::size_t>(index)], frame_mark) != frame_mark)
          static_cast<void>(with_points_.try_push_back(index));
      }
      if (index == BlockTable::kNone) continue;
      points += here;
      Voxel& voxel = table_.voxels(index)[place_in_block(row_x_[x], row_y_[x], row_z_[x])];
      if (voxel.last_hit != frame_mark) {
        voxel.last_hit = frame_mark;
        voxel.points = 0;
        ++distinct;
      }
      voxel.points = static_cast<std::uint8_t>(std::min(voxel.points + here, 255u));
    }
  }
  if (distinct == 0) return;
  reduction_sum_ += static_cast<double>(points) / static_cast<double>(distinct);
  ++reduced_frames_;
}

void VoxelMap::place_row(int y, const Pose& T_map_camera) {
  // In voxels from the camera's own voxel, so that single precision serves however far the camera is from the
  // origin.
  struct Axis {
    float rx, ry, rz, offset;
    std::int32_t whole;
    std::int32_t at(RayTable::Ray ray, float z_m) const {
      return whole + static_cast<std::int32_t>(std::floor(z_m * (rx * ray.x + ry * ray.y + rz) + offset));
    }
  };
  const double per_voxel = 1 / config_.voxel_m;
  const auto axis = [&](int i, double t_m) {
    const double t = per_voxel * t_m, whole = std::floor(t);
    return Axis{static_cast<float>(per_voxel * T_map_camera.R(i, 0)),
                static_cast<float>(per_voxel * T_map_camera.R(i, 1)),
                static_cast<float>(per_voxel * T_map_camera.R(i, 2)), static_cast<float>(t - whole),
                static_cast<std::int32_t>(whole)};
  };
  const Axis x_axis = axis(0, T_map_camera.t.x), y_axis = axis(1, T_map_camera.t.y),
             z_axis = axis(2, T_map_camera.t.z);
  const int width = camera_.width;
  const float* z_m = measured_.z_m().data() + static_cast<std::ptrdiff_t>(y) * width;
  std::int32_t *to_x = row_x_.data(), *to_y = row_y_.data(), *to_z = row_z_.data();
  for (int x = 0; x < width; ++x) {
    const RayTable::Ray ray = rays_.at(x, y);
    to_x[x] = x_axis.at(ray, z_m[x]);
    to_y[x] = y_axis.at(ray, z_m[x]);
    to_z[x] = z_axis.at(ray, z_m[x]);
  }
}

std::size_t VoxelMap::find_runs(int y) {
  const int width = camera_.width;
  const float* z_m = measured_.z_m().data() + static_cast<std::ptrdiff_t>(y) * width;
  const std::int32_t *at_x = row_x_.data(), *at_y = row_y_.data(), *at_z = row_z_.data();
  std::int32_t* begins = row_begins_.data();
  begins[0] = static_cast<int>(z_m[0] > 0);
  for (int x = 1; x < width; ++x) {
    const int same = static_cast<int>(at_x[x] == at_x[x - 1]) & static_cast<int>(at_y[x] == at_y[x - 1]) &
                     static_cast<int>(at_z[x] == at_z[x - 1]) & static_cast<int>(z_m[x - 1] > 0);
    begins[x] = static_cast<int>(z_m[x] > 0) & (1 - same);
  }
  // Without branches, since nobody can foretell where runs end.
  std::size_t runs = 0;
  std::uint32_t points = 0;
  for (int x = 0; x < width; ++x) {
    runs_[runs] = {static_cast<std::uint32_t>(x), points};
    runs += static_cast<std::size_t>(begins[x]);
    points += static_cast<std::uint32_t>(z_m[x] > 0);
  }
  runs_[runs] = {static_cast<std::uint32_t>(width), points};
  return runs;
}

Occupancy VoxelMap::at(Vec3 p) const {
  // Refuses NaN as well.
  const bool near =
      std::abs(p.x) < kMaxDistance_m && std::abs(p.y) < kMaxDistance_m && std::abs(p.z) < kMaxDistance_m;
  if (!near) return Occupancy::Unknown;
  const VoxelCoordinates v = voxel_at({p.x / config_.voxel_m, p.y / config_.voxel_m, p.z / config_.voxel_m});
  const int index = table_.find(block_of(v));
  if (index != BlockTable::kNone) return table_.voxels(index)[place_in_block(v)].occupancy();
  return free_space_.free(block_of(v)) ? Occupancy::Free : Occupancy::Unknown;
}

double VoxelMap::point_reduction() const {
  return reduced_frames_ == 0 ? 0 : reduction_sum_ / static_cast<double>(reduced_frames_);
}

}  // namespace stillmap
