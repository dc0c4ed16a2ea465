// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "core/camera.h"
#include "core/image.h"
#include "core/status.h"
#include "core/time.h"
#include "tests/support/synthetic_log/camera_path.h"
#include "tests/support/synthetic_log/ray_caster.h"
#include "tests/support/synthetic_log/room.h"
#include "tests/support/synthetic_log/walker.h"

namespace stillmap::synthetic {

struct SyntheticOptions {
  std::uint64_t seed = 1;  ///< another room, another path, other people
  int frames = 300;
  int people = 2;
  PathKind path = PathKind::Orbit;
  bool noise = true;  ///< false: an ideal sensor, without noise, holes, steps and motion blur
};

/// One frame, row by row, 640 x 480.
struct SyntheticFrame {
  Nanoseconds stamp_ns = 0;  ///< of colour and depth
  Pose T_world_camera;       ///< world: z up, origin on the floor
  std::vector<Bgr> colour;
  std::vector<std::uint16_t> depth;  ///< 5000 units per metre, 0 = no reading
  std::vector<std::uint8_t> mask;    ///< 0 = the room, k = the k-th person
  std::vector<float> true_depth_m;
};

/// A rendered RGB-D log at 30 Hz of a room that people in safety vests walk through, with exact ground truth.
/// The same options give the same bytes. One thread.
class SyntheticLog {
 public:
  explicit SyntheticLog(const SyntheticOptions& options);

  static CameraModel camera();
  const SyntheticOptions& options() const { return options_; }
  Nanoseconds stamp_ns(int index) const;
  /// At any time, on the clock of the stamps.
  Pose T_world_camera(Nanoseconds stamp_ns) const;
  /// Renders frame `index` >= 0, in any order.
  void render(int index, SyntheticFrame& frame);

 private:
  void look(double t_s, double x_offset_px, double y_offset_px);

  SyntheticOptions options_;
  CameraPath path_;
  Room room_;
  std::vector<Walker> walkers_;
  // With the first picture: it takes longer to paint the materials than to render one.
  std::vector<Texture> materials_;
  std::optional<RayCaster> caster_;
  std::vector<Shape> shapes_;
  std::vector<std::array<std::uint16_t, 3>> sums_;
};

/// Writes the log as a TUM RGB-D folder: rgb/*.jpg, depth/*.png, mask/*.png, rgb.txt, depth.txt,
/// associations.txt and groundtruth.txt (100 Hz, camera to world). The folder must be absent or empty. Uses
/// all processors.
Status write_synthetic_log(const SyntheticOptions& options, const std::filesystem::path& folder);

}  // namespace stillmap::synthetic
