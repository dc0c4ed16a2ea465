// SPDX-License-Identifier: Apache-2.0
#include "track/feature_extractor.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/vector_clones.h"

namespace stillmap {

namespace {

constexpr int kMargin = 19;  // the patch, its smoothing, and a pixel of rounding
constexpr int kCellPx = 30;
constexpr std::size_t kPerCell = 24;  // corners that one cell may offer

/// A total order, so that sorting is the same everywhere.
bool stronger_corner(const Corner& a, const Corner& b) {
  if (a.score != b.score) return a.score > b.score;
  return a.y != b.y ? a.y < b.y : a.x < b.x;
}

using U8x16 = std::uint8_t __attribute__((vector_size(16)));
using I16x16 = std::int16_t __attribute__((vector_size(32)));

[[gnu::always_inline]] inline I16x16 sixteen(const std::uint8_t* p, const std::uint8_t* mask) {
  U8x16 v, m;
  std::memcpy(&v, p, sizeof v);
  std::memcpy(&m, mask, sizeof m);
  return __builtin_convertvector(v & m, I16x16);
}

/// Of the patch around `c`, by its intensity centroid. Sums of columns first: sixteen bits hold them, also
/// where each pixel counts as often as its row is away from the middle one.
STILLMAP_VECTOR_CLONES float orientation(ImageView<const std::uint8_t> image, Corner c,
                                         const PatchMask& mask) {
  std::array<I16x16, 2> sums{}, moments{};
  for (int dy = -kPatchRadius; dy <= kPatchRadius; ++dy) {
    const std::uint8_t* p = image.row(c.y + dy) + c.x - kPatchRadius;
    const std::uint8_t* m = mask[static_cast<std::size_t>(std::abs(dy))].data();
    for (std::size_t half = 0; half < 2; ++half) {
      const I16x16 pixels = sixteen(p + 16 * half, m + 16 * half);
      sums[half] += pixels;
      moments[half] += static_cast<std::int16_t>(dy) * pixels;
    }
  }
  int m10 = 0, m01 = 0;
  for (int x = 0; x < 32; ++x) {
    const auto half = static_cast<std::size_t>(x / 16);
    m10 += (x - kPatchRadius) * sums[half][x % 16];
    m01 += moments[half][x % 16];
  }
  return std::atan2(static_cast<float>(m01), static_cast<float>(m10));
}

Descriptor describe(ImageView<const std::uint8_t> smooth, Corner c, const DescriptorPattern::Pairs& pairs) {
  const std::uint8_t* centre = smooth.row(c.y) + c.x;
  const std::ptrdiff_t stride = smooth.stride;
  Descriptor d;
  for (std::size_t word = 0; word < 4; ++word) {
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < 64; ++i) {
      const DescriptorPattern::Pair& p = pairs[word * 64 + i];
      const bool less = centre[p.y0 * stride + p.x0] < centre[p.y1 * stride + p.x1];
      bits |= static_cast<std::uint64_t>(less) << i;
    }
    d.bits[word] = bits;
  }
  return d;
}

}  // namespace

FeatureExtractor::FeatureExtractor(Arena& arena, const Config::Track& config, const CameraModel& camera)
    : config_(config),
      camera_(camera),
      pyramid_(arena, camera.width, camera.height, config.levels, config.scale_factor),
      ranked_(arena.take<Ranked>("corners", 40'000)) {
  for (int dy = 0; dy <= kPatchRadius; ++dy) {
    const int half_width =
        static_cast<int>(std::sqrt(static_cast<double>(kPatchRadius * kPatchRadius - dy * dy)));
    std::uint8_t* middle = &patch_mask_[static_cast<std::size_t>(dy)][kPatchRadius];
    std::fill(middle - half_width, middle + half_width + 1, std::uint8_t{255});
  }
}

void FeatureExtractor::extract(ImageView<const std::uint8_t> grey, FrameFeatures& out) {
  out.clear();
  pyramid_.build(grey);
  // Each level gets a share in proportion to its edge length, as ORB does.
  double total = 0;
  for (int level = 0; level < config_.levels; ++level) total += 1 / pyramid_.scale(level);
  for (int level = 0; level < config_.levels; ++level) {
    const double share = share_ * config_.features / pyramid_.scale(level) / total;
    extract_level(level, static_cast<std::size_t>(std::lround(share)), out);
  }
}

void FeatureExtractor::collect_corners(int level, int columns, int rows, int cell_px) {
  const ImageView<const std::uint8_t> image = pyramid_.image(level);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const int x0 = kMargin + column * cell_px, y0 = kMargin + row * cell_px;
      const int x1 = std::min(x0 + cell_px, image.width - kMargin),
                y1 = std::min(y0 + cell_px, image.height - kMargin);
      if (x1 <= x0 || y1 <= y0) continue;
      cell_.clear();
      fast_corners(image, x0, y0, x1, y1, config_.fast_threshold, cell_);
      if (cell_.empty()) fast_corners(image, x0, y0, x1, y1, config_.fast_threshold_min, cell_);
      std::sort(cell_.begin(), cell_.end(), stronger_corner);
      cell_.truncate(kPerCell);
      for (std::size_t i = 0; i < cell_.size(); ++i) {
        if (!ranked_.try_push_back({cell_[i], static_cast<std::uint16_t>(i)})) return;
      }
    }
  }
  return;
}

void FeatureExtractor::extract_level(int level, std::size_t wanted, FrameFeatures& out) {
  const ImageView<const std::uint8_t> image = pyramid_.image(level);
  const int columns = (image.width - 2 * kMargin + kCellPx - 1) / kCellPx;
  const int rows = (image.height - 2 * kMargin + kCellPx - 1) / kCellPx;
  ranked_.clear();
  collect_corners(level, columns, rows, kCellPx);
  // First the best of every cell, then every second best, ...: even over the picture, and of one rank the
  // strongest.
  if (ranked_.size() > wanted) {
    const auto stronger = [](const Ranked& a, const Ranked& b) {
      if (a.rank != b.rank) return a.rank < b.rank;
      return stronger_corner(a.corner, b.corner);
    };
    std::nth_element(ranked_.begin(), ranked_.begin() + wanted, ranked_.end(), stronger);
    std::sort(ranked_.begin(), ranked_.begin() + wanted, stronger);
    ranked_.resize_down(wanted);
  }
  for (const Ranked& r : ranked_) {
    const Feature feature = feature_at(level, r.corner);
    if (!out.features.try_push_back(feature)) return;
    static_cast<void>(out.descriptors.try_push_back(
        describe(pyramid_.smooth(level), r.corner, pattern_.at_angle(feature.angle_rad))));
  }
}

Feature FeatureExtractor::feature_at(int level, Corner corner) const {
  const ImageView<const std::uint8_t> image = pyramid_.image(level);
  // The same mapping of pixel centres as the resampling, with each level's true ratio after rounding its
  // size.
  const double x = (corner.x + corner.dx / 128.0 + 0.5) * camera_.width / image.width - 0.5;
  const double y = (corner.y + corner.dy / 128.0 + 0.5) * camera_.height / image.height - 0.5;
  const Vec2 ray = camera_.undistort({x, y});
  Feature f;
  f.x = static_cast<float>(x);
  f.y = static_cast<float>(y);
  f.ray_x = static_cast<float>(ray.x);
  f.ray_y = static_cast<float>(ray.y);
  f.angle_rad = orientation(image, corner, patch_mask_);
  f.response = corner.score;
  f.octave = static_cast<std::uint8_t>(level);
  return f;
}

}  // namespace stillmap
