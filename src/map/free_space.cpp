// SPDX-License-Identifier: Apache-2.0
#include "map/free_space.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap {

namespace {

int shift_for(double block_m) {
  int shift = 0;
  for (double edge_m = block_m; edge_m < FreeSpace::kLeastCell_m; edge_m *= 2) ++shift;
  return shift;
}

}  // namespace

FreeSpace::FreeSpace(Arena& arena, const CameraModel& camera, const RayTable& rays, double voxel_m,
                     double max_range_m)
    : lens_(camera, rays, arena.planning()),
      rays_(rays),
      width_(camera.width),
      height_(camera.height),
      columns_((camera.width + kTile_px - 1) / kTile_px),
      rows_((camera.height + kTile_px - 1) / kTile_px),
      shift_(shift_for(kBlockEdge * voxel_m)),
      cell_m_(kBlockEdge * voxel_m * (1 << shift_)),
      far_m_(max_range_m),
      tiles_m_(arena.take<float>("map_free_tiles", static_cast<std::size_t>(columns_ * rows_))),
      chunks_(arena.take<Chunk>("map_free_space", kChunks)) {}

void FreeSpace::measure_tiles(std::span<const float> z_m) {
  constexpr int kFewest = kTile_px * kTile_px / (kSampled_px * kSampled_px) / 2;
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const int x1 = std::min((column + 1) * kTile_px, width_), y1 = std::min((row + 1) * kTile_px, height_);
      float least = std::numeric_limits<float>::max();
      int readings = 0;
      for (int y = row * kTile_px; y < y1; y += kSampled_px) {
        for (int x = column * kTile_px; x < x1; x += kSampled_px) {
          const float z = std::abs(z_m[static_cast<std::size_t>(y * width_ + x)]);
          if (z == 0) continue;
          ++readings;
          least = std::min(least, z);
        }
      }
      tiles_m_[static_cast<std::size_t>(row * columns_ + column)] = readings >= kFewest ? least : 0;
    }
  }
}

float FreeSpace::tile_m(int column, int row) const {
  return tiles_m_[static_cast<std::size_t>(row * columns_ + column)];
}

bool FreeSpace::may_be_seen_through(Vec3 middle) const {
  const float x = static_cast<float>(middle.x), y = static_cast<float>(middle.y),
              z = static_cast<float>(middle.z);
  if (!lens_.may_see(x, y, z, 0)) return false;
  const Lens::Pixel pixel = lens_.pixel_of(x, y, z);
  return pixel.u >= 0 && tile_m(pixel.u / kTile_px, pixel.v / kTile_px) > z;
}

bool FreeSpace::seen_through(const std::array<Vec3, 8>& corners) const {
  int u0 = width_, u1 = 0, v0 = height_, v1 = 0;
  double deepest_m = 0;
  for (const Vec3& p : corners) {
    const Lens::Pixel pixel =
        lens_.pixel_of(static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z));
    if (pixel.u < 0) return false;
    u0 = std::min(u0, pixel.u);
    u1 = std::max(u1, pixel.u);
    v0 = std::min(v0, pixel.v);
    v1 = std::max(v1, pixel.v);
    deepest_m = std::max(deepest_m, p.z);
  }
  for (int row = v0 / kTile_px; row <= v1 / kTile_px; ++row) {
    for (int column = u0 / kTile_px; column <= u1 / kTile_px; ++column) {
      if (static_cast<double>(tile_m(column, row)) <= deepest_m) return false;
    }
  }
  return true;
}

void FreeSpace::see(const Pose& T_map_camera_depth, std::span<const float> z_m) {
  measure_tiles(z_m);
  Vec3 low = T_map_camera_depth.t, high = low;
  for (const auto& [x, y] : {std::pair(0, 0), {width_ - 1, 0}, {0, height_ - 1}, {width_ - 1, height_ - 1}}) {
    const RayTable::Ray ray = rays_.at(x, y);
    const Vec3 p = T_map_camera_depth * Vec3{ray.x * far_m_, ray.y * far_m_, far_m_};
    low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
  }
  const VoxelCoordinates first = voxel_at(1 / cell_m_ * low), last = voxel_at(1 / cell_m_ * high);
  const Pose T_camera_map = inverse(T_map_camera_depth);
  std::array<Vec3, 8> across;  // from a cube's first corner to each
  for (std::size_t i = 0; i < across.size(); ++i) {
    across[i] = T_camera_map.R * (cell_m_ * Vec3{static_cast<double>(i & 1), static_cast<double>(i >> 1 & 1),
                                                 static_cast<double>(i >> 2)});
  }
  const Vec3 step = across[1], to_middle = 0.5 * across[7];
  for (std::int32_t z = first.z; z <= last.z; ++z) {
    for (std::int32_t y = first.y; y <= last.y; ++y) {
      Vec3 begin = T_camera_map * (cell_m_ * Vec3{1.0 * first.x, 1.0 * y, 1.0 * z});
      for (std::int32_t x = first.x; x <= last.x; ++x, begin = begin + step) {
        // Most lie out of view or behind what was measured; one look at their middle tells.
        if (!may_be_seen_through(begin + to_middle)) continue;
        std::array<Vec3, 8> corners;
        std::ranges::transform(across, corners.begin(), [&](Vec3 to) { return begin + to; });
        if (seen_through(corners)) mark(place_of(x, y, z));
      }
    }
  }
}

FreeSpace::Place FreeSpace::place_of(std::int32_t x, std::int32_t y, std::int32_t z) const {
  const auto part = [](std::int32_t v) { return static_cast<std::uint64_t>(v >> 3) & 0x1fffff; };
  Place place;
  place.key = std::uint64_t{1} << 63 | part(x) << 42 | part(y) << 21 | part(z);
  place.home = static_cast<std::size_t>(place.key * 0x9e3779b97f4a7c15u >> 40) % kChunks;
  place.word = static_cast<std::size_t>(z & 7);
  place.bit = std::uint64_t{1} << ((x & 7) + 8 * (y & 7));
  return place;
}

const FreeSpace::Chunk* FreeSpace::find(const Place& place) const {
  for (std::size_t i = 0; i < kProbes; ++i) {
    const Chunk& chunk = chunks_[(place.home + i) % kChunks];
    if (chunk.key.load(std::memory_order_acquire) == place.key) return &chunk;
  }
  return nullptr;
}

void FreeSpace::mark(const Place& place) {
  Chunk* chunk = find(place);
  if (chunk == nullptr) {
    chunk = &chunks_[place.home];
    for (std::size_t i = kProbes; i-- > 0;) {
      Chunk& there = chunks_[(place.home + i) % kChunks];
      if (there.key.load(std::memory_order_relaxed) == 0) chunk = &there;
    }
    chunk->key.store(0, std::memory_order_release);
    for (std::atomic<std::uint64_t>& word : chunk->words) word.store(0, std::memory_order_release);
    chunk->key.store(place.key, std::memory_order_release);
  }
  std::atomic<std::uint64_t>& word = chunk->words[place.word];
  const std::uint64_t before = word.load(std::memory_order_relaxed);
  if ((before & place.bit) == 0) word.store(before | place.bit, std::memory_order_release);
}

void FreeSpace::fill(BlockCoordinates at) {
  const Place place = place_of(at);
  Chunk* chunk = find(place);
  if (chunk == nullptr) return;
  std::atomic<std::uint64_t>& word = chunk->words[place.word];
  word.store(word.load(std::memory_order_relaxed) & ~place.bit, std::memory_order_release);
}

void FreeSpace::clear() {
  for (Chunk& chunk : chunks_) chunk.key.store(0, std::memory_order_release);
}

bool FreeSpace::free(BlockCoordinates at) const {
  const Place place = place_of(at);
  const Chunk* chunk = find(place);
  if (chunk == nullptr) return false;
  const bool free = (chunk->words[place.word].load(std::memory_order_acquire) & place.bit) != 0;
  // Not that of another place which has taken the chunk over meanwhile.
  return free && chunk->key.load(std::memory_order_relaxed) == place.key;
}

}  // namespace stillmap
