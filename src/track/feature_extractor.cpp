// SPDX-License-Identifier: Apache-2.0
#include "track/feature_extractor.h"

#include <algorithm>
#include <cmath>

namespace stillmap {

namespace {

constexpr int kPatchRadius = 15;
constexpr int kMargin = 19;  // the patch, its smoothing, and a pixel of rounding
constexpr int kCellPx = 30;
constexpr std::size_t kPerCell = 24;  // corners that one cell may offer

/// A total order, so that sorting is the same everywhere.
bool stronger_corner(const Corner& a, const Corner& b) {
  if (a.score != b.score) return a.score > b.score;
  return a.y != b.y ? a.y < b.y : a.x < b.x;
}

float orientation(ImageView<const std::uint8_t> image, Corner c, const std::array<int, 16>& half_width) {
  int m10 = 0, m01 = 0;
  for (int dy = -kPatchRadius; dy <= kPatchRadius; ++dy) {
    const int half = half_width[static_cast<std::size_t>(std::abs(dy))];
    const std::uint8_t* p = image.row(c.y + dy) + c.x;
    int sum = 0, moment = 0;
    for (int dx = -half; dx <= half; ++dx) {
      sum += p[dx];
      moment += dx * p[dx];
    }
    m10 += moment;
    m01 += dy * sum;
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
    circle_half_width_[static_cast<std::size_t>(dy)] =
        static_cast<int>(std::sqrt(static_cast<double>(kPatchRadius * kPatchRadius - dy * dy)));
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
  f.angle_rad = orientation(image, corner, circle_half_width_);
  f.response = corner.score;
  f.octave = static_cast<std::uint8_t>(level);
  return f;
}

}  // namespace stillmap
