// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/camera.h"
#include "core/dynamic_mask.h"
#include "core/status.h"

namespace stillmap {

/// Parts of tracking that can be left out, to measure what each is worth.
inline constexpr std::array<std::string_view, 7> kTrackParts{
    "carried_boxes", "motion_check", "point_trust", "alignment", "sampling", "adjustment", "loops"};

/// Every setting of the runtime, in one struct with defaults. The names, units, ranges and help of the keys
/// stand in one place, `describe()` in config_keys.cpp. Written once at start, read-only after it.
struct Config {
  struct Runtime {
    std::int64_t seed = 1;
    std::string flight_recorder;
  } runtime;
  struct Threads {
    int tracking_core = -1, other_core = -1;
    bool realtime = false;
  } threads;
  struct Memory {
    double budget_mb = 160;
    bool lock = false;
  } memory;
  CameraModel camera;
  struct CameraMount {
    std::string name = "unnamed";
    double fps = 30;
    /// x, y, z in m and the quaternion x, y, z, w of the camera in the robot's base (x forward, z up).
    std::optional<std::array<double, 7>> T_base_camera;
  } mount;
  /// How a live camera is opened and looked after; a log needs none of it.
  struct Device {
    std::string colour_format, depth_format;  ///< four letters as the kernel's; empty: the device's best
    std::vector<std::string> colour_controls, depth_controls;  ///< NAME=VALUE
    double stall_s = 2;
    double give_up_s = 30;
    /// The lens of a depth camera that does not register by itself; width 0: it does.
    CameraModel depth;
    std::optional<std::array<double, 7>> T_colour_depth;  ///< as CameraMount::T_base_camera
  } device;
  struct Record {
    std::string colour = "jpeg";
    int jpeg_quality = 95;
    int buffer_frames = 8;
  } record;
  struct Detector {
    std::string model = "auto";
    std::string sha256;
    // Of the model; a manifest beside it says them all. The defaults are NanoDet-Plus's.
    std::string decoder = "nanodet_plus";
    int input_width = 320, input_height = 256;
    std::vector<int> strides;  ///< px of the input between two cells; empty: as the names of the outputs say
    std::string colour_order = "bgr";
    std::array<double, 3> mean{103.53, 116.28, 123.675}, deviation{57.375, 57.12, 58.395};
    int pad = 0;
    double score_threshold = 0.25, confirm_score = 0.4;
    double nms_iou = 0.5;
    int max_age_ms = 700;
  } detector;
  struct Classes {
    std::vector<std::string> names;
    std::vector<std::string> dynamic, semi_static, pure_static;
  } classes;
  struct Track {
    /// Names of `kTrackParts`.
    std::vector<std::string> without;
    bool has(std::string_view part) const { return std::ranges::find(without, part) == without.end(); }

    DynamicRule dynamic_rule = DynamicRule::Silhouette;
    int features = 1000;
    int levels = 8;
    double scale_factor = 1.2;
    int fast_threshold = 20, fast_threshold_min = 7;
    int keyframes = 64;
    int points = 20000;
    int min_inliers = 20;
    int weak_inliers = 50;
    double lost_s = 2;
    double epipolar_threshold_px = 1.5;
  } track;
  struct Map {
    double voxel_m = 0.04;
    int capacity_voxels = 2'000'000;
    int kept_blocks = 20'000;
    int fuse_every = 2;
    double max_range_m = 4.5;
    int keyframe_copies = 32;
    double save_timeout_s = 30;
    double checkpoint_s = 60;
  } map;
  struct Stream {
    std::string listen = "127.0.0.1:8765";
    int max_clients = 8;
    std::string preview = "masked", full_preview_to = "loopback";
    std::string token_file, tls_certificate, tls_key;
    std::vector<std::string> origins{"https://app.foxglove.dev", "https://lichtblick-suite.github.io"};
  } stream;
};

/// One key with its current value and where the value came from, for `check --dump`.
struct ConfigEntry {
  std::string key, value, unit, origin, help;
};

/// The settings plus, for each key, their origin.
struct LoadedConfig {
  Config config;
  std::vector<ConfigEntry> entries;
};

/// Reads the TOML files in order (later ones override earlier ones), then applies `overrides` of the form
/// KEY=VALUE, then checks. A relative path inside a file is relative to that file. The error names file, key,
/// value, what was expected and the unit.
Result<LoadedConfig> load_config(std::span<const std::string> files, std::span<const std::string> overrides);

/// Whether one of these files sets a key that every camera must have. False also for one that cannot be read:
/// load_config() says so.
bool describes_camera(std::span<const std::string> files);

/// The pose that seven numbers of a configuration stand for: x, y, z in m and the quaternion x, y, z, w.
Pose pose_from(const std::array<double, 7>& numbers);

/// Every key with its value, unit and origin, one line each, in a fixed order.
std::string config_text(const LoadedConfig& loaded);

}  // namespace stillmap
