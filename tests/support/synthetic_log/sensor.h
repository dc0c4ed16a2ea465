// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "core/camera.h"
#include "core/image.h"
#include "tests/support/synthetic_log/random.h"

namespace stillmap::synthetic {

/// What a structured-light camera makes of the true depth (m, row by row): noise of camera.depth_sigma_m,
/// steps of 1/8 px of disparity, no reading (0) nearer than 0.4 m, beyond 6 m, at outlines, and where a
/// nearer thing stands between the surface and the projector beside the camera. Writes raw units.
void measure_depth(std::span<const float> truth_m, const CameraModel& camera, Random& random,
                   std::span<std::uint16_t> raw);
/// The true depth in raw units, as far as 16 bits hold it.
void measure_depth_ideally(std::span<const float> truth_m, const CameraModel& camera,
                           std::span<std::uint16_t> raw);

/// The mean of `exposures` summed pictures (r, g, b), with noise that grows with the light where `random` is
/// given.
void measure_colour(std::span<const std::array<std::uint16_t, 3>> sums, int exposures, Random* random,
                    std::span<Bgr> out);

}  // namespace stillmap::synthetic
