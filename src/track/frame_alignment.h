// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "core/arena.h"
#include "core/camera.h"
#include "core/dynamic_mask.h"
#include "core/fixed_vector.h"
#include "core/image.h"
#include "track/pose_solver.h"

namespace stillmap {

/// Where the camera went since the last frame, by small pictures alone: a hand that jerks leaves any motion
/// model behind, and features are looked for around where this says they are.
///
/// Direct alignment of the picture before, with its depth, to the new one at 1/16 and 1/8 of the size (Klein
/// and Murray's small blurry image, ECCV 2008, with the warp and residual of Kerl et al., IROS 2013):
/// Gauss-Newton with the inverse compositional Jacobian, Huber weights, one brightness offset, and the motion
/// model as a prior. Pixels of movers have no say. Used by one thread; no heap after construction.
class FrameAlignment {
 public:
  FrameAlignment(Arena& arena, const CameraModel& camera);

  /// Shrinks the new picture. Once per frame.
  void take(ImageView<const std::uint8_t> grey);
  /// The picture just taken is what the next one is compared with. `depth` and `mask` are its own.
  void remember(ImageView<const std::uint16_t> depth, const DynamicMask& mask);
  /// There is nothing to compare the next one with.
  void forget();

  /// T_camera_before: from the remembered picture's camera to the new one's, sought around where `prior` has
  /// it (`prior.T_camera_world` is this same motion). The prior's where nothing fits better.
  Pose align(const PosePrior& prior);
  /// Whether what `align` found last is the picture's word rather than the prior's: most of what it shows
  /// agrees, but for the movers that `mask` has in the new picture, and tells more of the turn than the
  /// prior.
  bool holds(const DynamicMask& mask) const;

 private:
  /// A pixel of the picture before that has depth: where it is, and how its brightness would change with the
  /// camera's motion.
  struct Sample {
    std::array<float, 3> p_camera{};
    float value = 0;
    std::array<float, 6> jacobian{};  // by p's left perturbation: rotation in rad, translation in m
  };
  struct Level {
    CameraModel camera;  // a pinhole: what the lens bends, it bends alike in both pictures
    ImageView<float> image;
    ArenaVector<Sample> samples;
  };
  struct Equations;
  struct Aligned {
    Pose T_camera_before;
    float offset = 0;  // of brightness
    PosePrior prior;
  };
  void sample(Level& level, ImageView<const std::uint16_t> depth, const DynamicMask& mask) const;
  Equations equations_at(const Level& level, const Pose& T_camera_before, float offset,
                         const DynamicMask* mask = nullptr) const;

  CameraModel camera_;
  std::array<Level, 2> levels_;  // the finer one first
  std::optional<Aligned> aligned_;
  std::span<std::uint32_t> sums_;
  std::span<float> row_;
};

}  // namespace stillmap
