// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_log/sensor.h"

#include <algorithm>
#include <cmath>

namespace stillmap::synthetic {

namespace {

constexpr double kNearest_m = 0.4, kFarthest_m = 6;
/// Between projector and camera of a Kinect: 75 mm.
constexpr double kBaseline_m = 0.075;

/// Whether the depth jumps between a pixel and a neighbour, or the surface is seen at a very flat angle.
bool outline(float a, float b) {
  return std::abs(a - b) > 0.02f * std::min(a, b);
}

}  // namespace

void measure_depth(std::span<const float> truth_m, const CameraModel& camera, Random& random,
                   std::span<std::uint16_t> raw) {
  const auto disparity_px_m = static_cast<float>(camera.fx * kBaseline_m);
  const auto width = static_cast<std::size_t>(camera.width), height = static_cast<std::size_t>(camera.height);
  std::fill(raw.begin(), raw.end(), std::uint16_t{0});
  for (std::size_t y = 0; y < height; ++y) {
    // The projector stands left of the camera: what it lights moves to the right by the disparity. Where a
    // pixel of the row has been moved farther already, that nearer surface keeps the light from this one.
    float lit_to_px = -1;
    for (std::size_t x = 0; x < width; ++x) {
      const std::size_t i = y * width + x;
      const float z = truth_m[i];
      const float noisy_m = z + random.gaussian() * static_cast<float>(camera.depth_sigma_m(z));
      const float lit_px = static_cast<float>(x) + disparity_px_m / z;
      const bool in_shadow = lit_px < lit_to_px;
      lit_to_px = std::max(lit_to_px, lit_px);
      if (in_shadow || noisy_m < kNearest_m || noisy_m > kFarthest_m) continue;
      if ((x + 1 < width && outline(z, truth_m[i + 1])) ||
          (y + 1 < height && outline(z, truth_m[i + width])) || (x > 0 && outline(z, truth_m[i - 1])) ||
          (y > 0 && outline(z, truth_m[i - width]))) {
        continue;
      }
      const float steps = std::round(8 * disparity_px_m / noisy_m);
      raw[i] = static_cast<std::uint16_t>(
          std::lround(8 * disparity_px_m / steps * static_cast<float>(camera.depth_units_per_m)));
    }
  }
}

void measure_depth_ideally(std::span<const float> truth_m, const CameraModel& camera,
                           std::span<std::uint16_t> raw) {
  for (std::size_t i = 0; i < raw.size(); ++i) {
    const double units = std::round(truth_m[i] * camera.depth_units_per_m);
    raw[i] = units < 65536 ? static_cast<std::uint16_t>(units) : std::uint16_t{0};
  }
}

void measure_colour(std::span<const std::array<std::uint16_t, 3>> sums, int exposures, Random* random,
                    std::span<Bgr> out) {
  std::array<float, 256> sigma{};
  for (std::size_t i = 0; i < sigma.size(); ++i) sigma[i] = std::sqrt(2.0f + 0.04f * static_cast<float>(i));
  const auto value = [&](std::uint16_t sum) {
    const float mean = static_cast<float>(sum) / static_cast<float>(exposures);
    const float noise = random != nullptr ? random->gaussian() * sigma[static_cast<std::size_t>(mean)] : 0;
    return static_cast<std::uint8_t>(std::clamp(mean + noise + 0.5f, 0.0f, 255.0f));
  };
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i].r = value(sums[i][0]);
    out[i].g = value(sums[i][1]);
    out[i].b = value(sums[i][2]);
  }
}

}  // namespace stillmap::synthetic
