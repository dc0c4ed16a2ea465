// SPDX-License-Identifier: Apache-2.0
#include "map/block_fuser.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace stillmap {

namespace {

/// Pictures that a voxel's colour averages at most; beyond, newer pictures replace older ones. More would
/// need finer colours than 8 bits to still move.
constexpr int kMaxColourWeight = 15;

// Measured on fr1_rpy with true poses, on a wall at 4 m and a floor seen at a grazing angle: 2.5 sigma
// instead finds the same surfaces and makes the wall 3.6 voxels thick instead of 3.1; not counting points
// loses three tenths of the floor.
constexpr float kTruncationSigmas = 1.5f;
constexpr double kEnoughPoints = 0.1;                     // of the pixels that a voxel's face would fill
constexpr float kMostPoints = 255;                        // what Voxel::points can hold
constexpr int kHitNearUnsure = Voxel::kOccupied / 3 + 1;  // three looks make it occupied

std::array<float, 3> narrowed(Vec3 p) {
  return {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
}

/// 2^18 / (weight + 1), rounded up: a product and a shift take a tenth of a division's time.
constexpr auto kShares = [] {
  std::array<int, kMaxColourWeight + 1> shares{};
  for (int weight = 0; weight <= kMaxColourWeight; ++weight)
    shares[static_cast<std::size_t>(weight)] = ((1 << 18) + weight) / (weight + 1);
  return shares;
}();
constexpr int share_of(int sum, int weight) {
  return sum * kShares[static_cast<std::size_t>(weight)] >> 18;
}
static_assert([] {
  for (int weight = 0; weight <= kMaxColourWeight; ++weight) {
    for (int sum = 0; sum <= 255 * (weight + 1) + (weight + 1) / 2; ++sum) {
      if (share_of(sum, weight) != sum / (weight + 1)) return false;
    }
  }
  return true;
}());

std::uint8_t averaged(std::uint8_t mean, std::uint8_t value, int weight) {
  return static_cast<std::uint8_t>(share_of(mean * weight + value + (weight + 1) / 2, weight));
}

}  // namespace

BlockFuser::BlockFuser(Arena& arena, const CameraModel& camera, const RayTable& rays, const MoverTrail* trail,
                       double voxel_m, int looks)
    : lens_(camera, rays, arena.planning()),
      horizon_(arena, camera, rays),
      trail_(trail),
      looks_(looks),
      voxel_m_(voxel_m),
      least_truncation_m_(static_cast<float>(voxel_m)),
      truncation_m_at_1m_(kTruncationSigmas * static_cast<float>(camera.depth_noise_m_at_1m)),
      enough_points_at_1m_(static_cast<float>(kEnoughPoints * camera.fx * camera.fy * voxel_m * voxel_m)),
      width_(camera.width) {}

void BlockFuser::begin_frame(const Pose& T_map_camera_depth, const Pose& T_map_camera_colour,
                             std::span<const float> z_m, ImageView<const Bgr> colour, double max_range_m,
                             std::uint16_t frame_mark) {
  T_depth_map_ = inverse(T_map_camera_depth);
  T_colour_depth_ = inverse(T_map_camera_colour) * T_map_camera_depth;
  z_m_ = z_m;
  if (!z_m.empty()) horizon_.take(z_m);
  colour_ = colour;
  far_m_ = static_cast<float>(max_range_m);
  frame_mark_ = frame_mark;
}

Vec3 BlockFuser::first_centre_in_map(BlockCoordinates at) const {
  const auto centre_m = [this](std::int32_t block) {
    return (kBlockEdge * static_cast<double>(block) + 0.5) * voxel_m_;
  };
  return {centre_m(at.x), centre_m(at.y), centre_m(at.z)};
}

BlockFuser::Ball BlockFuser::ball_around(BlockCoordinates at) const {
  const double to_middle_m = (kBlockEdge - 1) * 0.5 * voxel_m_;
  return {narrowed(T_depth_map_ * (first_centre_in_map(at) + Vec3{to_middle_m, to_middle_m, to_middle_m})),
          static_cast<float>(to_middle_m * std::sqrt(3.0))};
}

bool BlockFuser::sees(const Ball& ball) const {
  const auto [x, y, z] = ball.middle;
  return z - ball.radius_m < far_m_ && lens_.may_see(x, y, z, ball.radius_m);
}

bool BlockFuser::in_view(BlockCoordinates at) const {
  return sees(ball_around(at));
}

bool BlockFuser::may_tell(BlockCoordinates at) const {
  const Ball ball = ball_around(at);
  if (!sees(ball)) return false;
  const auto [x, y, z] = ball.middle;
  const float farthest = horizon_.farthest_m(x, y, z, ball.radius_m);
  return z - ball.radius_m <= farthest + truncation_m(farthest);
}

BlockFuser::Change BlockFuser::fuse(BlockCoordinates at, std::span<Voxel, kBlockVoxels> voxels) const {
  static_assert(Lens::kRow == kBlockEdge);
  const Vec3 first_map = first_centre_in_map(at), first = T_depth_map_ * first_map;
  const Mat3& R = T_depth_map_.R;
  const Vec3 step_y = voxel_m_ * Vec3{R(0, 1), R(1, 1), R(2, 1)};
  const Vec3 step_z = voxel_m_ * Vec3{R(0, 2), R(1, 2), R(2, 2)};
  const Point step_x = narrowed(voxel_m_ * Vec3{R(0, 0), R(1, 0), R(2, 0)});
  Change change;
  for (int z = 0; z < kBlockEdge; ++z) {
    for (int y = 0; y < kBlockEdge; ++y) {
      const Point begin = narrowed(first + static_cast<double>(y) * step_y + static_cast<double>(z) * step_z);
      const Vec3 begin_map = first_map + voxel_m_ * Vec3{0, static_cast<double>(y), static_cast<double>(z)};
      fuse_row(begin_map, begin, step_x, voxels.data() + kBlockEdge * (y + kBlockEdge * z), change);
    }
  }
  return change;
}

void BlockFuser::fuse_row(Vec3 begin_map, const Point& begin, const Point& step, Voxel* voxels,
                          Change& change) const {
  const Lens::PixelRow pixels = lens_.pixels_of(begin, step);
  const EvidenceRow by_depth = evidence_of(pixels, begin[2], step[2]);
  for (std::size_t i = 0; i < kBlockEdge; ++i) {
    Voxel& voxel = voxels[i];
    const bool holds_any = voxel.last_hit == frame_mark_;
    // Air that is as sure as can be is not written again.
    const bool settled = by_depth[i] == kFree && voxel.log_odds == Voxel::kMin;
    if (pixels.u[i] < 0 || ((by_depth[i] == 0 || settled) && !holds_any)) continue;
    const float s = static_cast<float>(i);
    const Point p{begin[0] + s * step[0], begin[1] + s * step[1], begin[2] + s * step[2]};
    const Occupancy before = voxel.occupancy();
    if (by_depth[i] == kOccupied || holds_points(voxel, p[2])) {
      const Vec3 p_map = begin_map + Vec3{static_cast<double>(i) * voxel_m_, 0, 0};
      if (const Bgr* colour = colour_at(p)) change.shown |= hit(voxel, *colour, worth_of(voxel, p_map));
    } else if (by_depth[i] == kFree) {
      change.shown |= miss(voxel);
    }
    const Occupancy after = voxel.occupancy();
    change.known |= after != before;
    change.occupied +=
        static_cast<int>(after == Occupancy::Occupied) - static_cast<int>(before == Occupancy::Occupied);
  }
}

BlockFuser::EvidenceRow BlockFuser::evidence_of(const Lens::PixelRow& pixels, float begin_m,
                                                float step_m) const {
  std::array<float, kBlockEdge> measured_m{};
  for (std::size_t i = 0; i < kBlockEdge; ++i) {
    if (pixels.u[i] >= 0) measured_m[i] = z_m_[static_cast<std::size_t>(pixels.v[i] * width_ + pixels.u[i])];
  }
  // Without branches, so that the compiler does several voxels at once.
  EvidenceRow row;
  for (std::size_t i = 0; i < kBlockEdge; ++i) {
    const float z = std::abs(measured_m[i]);
    const float d = begin_m + static_cast<float>(static_cast<int>(i)) * step_m - z;
    const float t = truncation_m(z);
    const int free = static_cast<int>(z > 0) & static_cast<int>(d < -t);
    const int near = static_cast<int>(measured_m[i] > 0) & static_cast<int>(std::abs(d) <= 0.5f * t);
    row[i] = free * kFree + near * kOccupied;
  }
  return row;
}

bool BlockFuser::holds_points(const Voxel& voxel, float depth_m) const {
  if (voxel.last_hit != frame_mark_) return false;
  const float enough = enough_points_at_1m_ / (depth_m * depth_m);
  return static_cast<float>(voxel.points) >= std::min(enough, kMostPoints);
}

const Bgr* BlockFuser::colour_at(const Point& p_depth) const {
  const Point p = narrowed(T_colour_depth_ * Vec3{p_depth[0], p_depth[1], p_depth[2]});
  const Lens::Pixel pixel = lens_.pixel_of(p[0], p[1], p[2]);
  return pixel.u < 0 ? nullptr : &colour_.at(pixel.u, pixel.v);
}

BlockFuser::Worth BlockFuser::worth_of(const Voxel& voxel, Vec3 p_map) const {
  if (trail_ == nullptr || voxel.occupied()) return {};
  switch (trail_->near(p_map)) {
    case MoverTrail::Nearness::Sure:
      return {.most = Voxel::kOccupied - 1};
    case MoverTrail::Nearness::Unsure:
      return {.step = kHitNearUnsure};
    case MoverTrail::Nearness::None:
      break;
  }
  return {};
}

bool BlockFuser::hit(Voxel& voxel, const Bgr& colour, Worth worth) const {
  const Voxel before = voxel;
  voxel.log_odds = static_cast<std::int8_t>(std::min(voxel.log_odds + looks_ * worth.step, worth.most));
  const int weight = voxel.colour_weight;
  voxel.colour = {averaged(before.colour.b, colour.b, weight), averaged(before.colour.g, colour.g, weight),
                  averaged(before.colour.r, colour.r, weight)};
  voxel.colour_weight = static_cast<std::uint8_t>(std::min(weight + 1, kMaxColourWeight));
  const bool same_colour = voxel.colour.b == before.colour.b && voxel.colour.g == before.colour.g &&
                           voxel.colour.r == before.colour.r;
  return voxel.occupied() && !(before.occupied() && same_colour);
}

bool BlockFuser::miss(Voxel& voxel) const {
  const bool was_occupied = voxel.occupied();
  voxel.log_odds = static_cast<std::int8_t>(std::max(voxel.log_odds + looks_ * Voxel::kMiss, Voxel::kMin));
  // What stands here next has a colour of its own.
  if (voxel.log_odds < 0) voxel.colour_weight = 0;
  return was_occupied && !voxel.occupied();
}

}  // namespace stillmap
