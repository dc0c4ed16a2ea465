// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/config.h"
#include "core/feature.h"
#include "core/image.h"
#include "track/descriptor_pattern.h"
#include "track/fast_corners.h"
#include "track/pyramid.h"

namespace stillmap {

/// Which pixels of a patch count, by their row's distance from the middle one: 255 within a circle, else 0.
/// As many in a row as vectors hold.
inline constexpr int kPatchRadius = 15;
using PatchMask = std::array<std::array<std::uint8_t, 2 * kPatchRadius + 2>, kPatchRadius + 1>;

/// The features of one frame: `features[i]` is described by `descriptors[i]`.
struct FrameFeatures {
  ArenaVector<Feature> features;
  ArenaVector<Descriptor> descriptors;

  FrameFeatures(Arena& arena, std::size_t capacity)
      : features(arena.take<Feature>("features", capacity)),
        descriptors(arena.take<Descriptor>("features.descriptors", capacity)) {}
  void clear() {
    features.clear();
    descriptors.clear();
  }
};

/// Corners spread evenly over picture and pyramid, with orientation (intensity centroid; Rublee et al., ICCV
/// 2011), a 256-bit descriptor of their smoothed surroundings, and their undistorted ray. Depth and label are
/// left open. Used by one thread; no heap after construction.
class FeatureExtractor {
 public:
  FeatureExtractor(Arena& arena, const Config::Track& config, const CameraModel& camera);
  void extract(ImageView<const std::uint8_t> grey, FrameFeatures& out);
  /// Of `track.features`, how much is looked for from the next frame on; 1 at first.
  void set_share(double share) { share_ = share; }
  double scale(int octave) const { return pyramid_.scale(octave); }
  /// How well a corner is localised: 1 sigma, at full resolution.
  double sigma_px(int octave) const { return kCornerSigma_px * scale(octave); }

 private:
  void extract_level(int level, std::size_t wanted, FrameFeatures& out);
  void collect_corners(int level, int columns, int rows, int cell_px);
  Feature feature_at(int level, Corner corner) const;

  static constexpr double kCornerSigma_px = 0.65;  // in pixels of the corner's octave
  struct Ranked {
    Corner corner;
    std::uint16_t rank;  // how many stronger corners the same cell has
  };
  Config::Track config_;
  double share_ = 1;
  CameraModel camera_;
  Pyramid pyramid_;
  DescriptorPattern pattern_;
  PatchMask patch_mask_{};
  CellCorners cell_;
  ArenaVector<Ranked> ranked_;
};

}  // namespace stillmap
