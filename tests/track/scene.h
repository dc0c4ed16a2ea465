// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/arena.h"
#include "core/config.h"
#include "core/dynamic_mask.h"
#include "core/feature.h"
#include "core/frame_pool.h"
#include "core/random.h"
#include "tests/support/read_image.h"
#include "tests/support/synthetic_log/synthetic_log.h"

namespace stillmap::test {

/// Enough for every part of the tracker at once.
constexpr std::size_t kArenaBytes = std::size_t{96} << 20;

/// Settings for pictures of SyntheticLog.
Config synthetic_config();

Image<std::uint8_t> grey_of(const std::vector<Bgr>& colour, int width, int height);

/// A rendered frame as the tracker takes it, with the truth.
struct Scene {
  synthetic::SyntheticFrame truth;
  Image<std::uint8_t> grey;

  Scene() = default;
  Scene(synthetic::SyntheticLog& log, int index);
  ImageView<const std::uint16_t> depth() const { return {truth.depth.data(), 640, 480, 640}; }
  FrameSlot slot(std::uint64_t sequence);
  /// What a perfect detector and segmentation would say: the people's pixels with their depth.
  DynamicMask mask() const;
};

/// The picture as a mean over 33 by 33 pixels leaves it: no corner is left, but its large shapes are.
void blur(Scene& scene);

/// Repeated draws with mean 0 and sigma 1.
double gaussian(Random& random);
Vec3 gaussian_vec(Random& random, double sigma);

/// A feature that sees `p_camera` exactly.
Feature feature_of(const CameraModel& camera, Vec3 p_camera, Label label = Label::Static);
Descriptor random_descriptor(Random& random);

double angle_between(const Pose& a, const Pose& b);

}  // namespace stillmap::test
