// SPDX-License-Identifier: Apache-2.0
#include "runtime/depth_check.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace stillmap {

namespace {

constexpr int kEveryFrame = 10, kEveryRow = 8, kLooks = 10;
constexpr std::uint64_t kFewestEdges = 2000;
// Registered benchmark logs have their best agreement within 3 px of the middle: structured light eats at
// edges.
constexpr int kSureShift_px = 6;

}  // namespace

DepthCheck::Verdict DepthCheck::look(const FrameSlot& frame) {
  if (frames_++ % kEveryFrame != 0) return {};
  for (int y = kEveryRow / 2; y < frame.depth.height; y += kEveryRow) {
    const std::uint16_t* depth = frame.depth.row(y);
    for (int x = 0; x < frame.depth.width; x += 4) {
      ++pixels_;
      if (depth[x] == 0) continue;
      ++readings_;
      out_of_range_ += camera_.depth_m(depth[x]) == 0 ? 1 : 0;
    }
    compare_edges(depth, frame.colour.row(y), frame.depth.width);
  }
  if (++looks_ % kLooks != 0) return {};
  const Verdict verdict = judge();
  pixels_ = readings_ = out_of_range_ = edges_ = 0;
  contrast_.fill(0);
  return verdict;
}

void DepthCheck::compare_edges(const std::uint16_t* depth, const Bgr* colour, int width) {
  for (int x = kMaxShift + 3; x < width - kMaxShift - 3; ++x) {
    const int left = depth[x - 2], right = depth[x + 2];
    // A step between two surfaces, by a tenth of the nearer one's distance, sharpest here.
    if (left == 0 || right == 0 || std::abs(left - right) * 10 < std::min(left, right)) continue;
    ++edges_;
    for (int shift = -kMaxShift; shift <= kMaxShift; ++shift) {
      const int at = x + shift;
      contrast_[static_cast<std::size_t>(shift + kMaxShift)] +=
          static_cast<std::uint64_t>(std::abs(luma(colour[at + 2]) - luma(colour[at - 2])));
    }
  }
}

DepthCheck::Verdict DepthCheck::judge() const {
  const auto percent = [](std::uint64_t part, std::uint64_t whole) {
    return static_cast<int>(100 * part / std::max<std::uint64_t>(whole, 1));
  };
  const int empty = percent(pixels_ - readings_, pixels_), out = percent(out_of_range_, readings_);
  if (empty >= 90) return {DepthFault::Empty, empty};
  if (out >= 60) return {DepthFault::Scale, out};
  if (edges_ < kFewestEdges) return {};
  const auto best = std::max_element(contrast_.begin(), contrast_.end());
  const auto shift = static_cast<int>(best - contrast_.begin()) - kMaxShift;
  std::uint64_t sum = 0;
  for (const std::uint64_t c : contrast_) sum += c;
  const double mean = static_cast<double>(sum) / static_cast<double>(contrast_.size());
  const double peak = static_cast<double>(*best), here = static_cast<double>(contrast_[kMaxShift]);
  // The peak stands out (registered logs have 1.5 to 1.9), and the middle does not share in it.
  const bool sure = peak > 1.25 * mean && peak - here > 0.6 * (peak - mean);
  if (std::abs(shift) < kSureShift_px || !sure) return {};
  return {DepthFault::Unregistered, shift};
}

}  // namespace stillmap
