// SPDX-License-Identifier: Apache-2.0
#include "runtime/source.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>

#include "drivers/paired/paired.h"
#include "drivers/tum_log/tum_log.h"
#include "runtime/driver_module.h"

#ifdef STILLMAP_HAS_V4L2
#include "drivers/v4l2/v4l2_stream.h"
#endif

namespace stillmap {

namespace {

constexpr const char *kTum = "tum:", *kV4l2 = "v4l2:", *kOpenni2 = "openni2:", *kLibcamera = "libcamera:";

Paired::Setup pair_setup(const std::string& uri, const Config& config) {
  Paired::Setup setup{.name = uri, .colour = config.camera, .fps = config.mount.fps};
  if (config.device.depth.width > 0) {
    setup.depth_lens = config.device.depth;
    setup.T_colour_depth = pose_from(*config.device.T_colour_depth);
  }
  return setup;
}

Result<OpenedSource> open_log(const std::string& uri, const Config& config, int loops) {
  const Result<std::string> folder = log_folder(uri);
  if (!folder.ok()) return folder.error();
  auto log = std::make_unique<TumLog>(folder.value(), config.camera.width, config.camera.height, loops);
  if (Status s = log->open(); !s.ok()) return s.error();
  OpenedSource source;
  source.stamps.assign(log->colour_stamps().begin(), log->colour_stamps().end());
  source.driver = std::move(log);
  return source;
}

/// A recording ends, and cannot be opened anew in its middle; a camera can.
Result<OpenedSource> open_camera(const ReopeningSource::Factory& make, const Config& config) {
  OpenedSource source;
  source.news = std::make_unique<SourceNews>();
  source.driver = std::make_unique<ReopeningSource>(
      make, ReopeningSource::Patience{config.device.stall_s, config.device.give_up_s}, *source.news);
  if (Status s = source.driver->open(); !s.ok()) return s.error();
  return source;
}

#ifdef STILLMAP_HAS_V4L2
V4l2Request depth_request(const std::string& node, const Paired::Setup& setup, const Config& config) {
  const CameraModel& lens = setup.depth_lens ? *setup.depth_lens : config.camera;
  return {.device = node,
          .depth = true,
          .width = lens.width,
          .height = lens.height,
          .fps = config.mount.fps,
          .format = config.device.depth_format,
          .controls = config.device.depth_controls};
}

Result<OpenedSource> open_v4l2(const std::string& uri, const std::string& nodes, const Config& config) {
  const std::size_t comma = nodes.find(',');
  if (comma == std::string::npos || comma == 0 || comma + 1 == nodes.size()) {
    return Error{ExitCode::WrongConfig, "--source " + uri +
                                            ": expected v4l2:COLOUR,DEPTH, two video nodes such as "
                                            "/dev/video4,/dev/video2; `stillmap devices` lists them"};
  }
  const Paired::Setup setup = pair_setup(uri, config);
  const V4l2Request colour{.device = nodes.substr(0, comma),
                           .depth = false,
                           .width = config.camera.width,
                           .height = config.camera.height,
                           .fps = config.mount.fps,
                           .format = config.device.colour_format,
                           .controls = config.device.colour_controls};
  const V4l2Request depth = depth_request(nodes.substr(comma + 1), setup, config);
  return open_camera(
      [setup, colour, depth] {
        return std::make_unique<Paired>(setup, std::make_unique<V4l2Stream>(colour),
                                        std::make_unique<V4l2Stream>(depth));
      },
      config);
}

void find_v4l2(std::vector<FoundSource>& found) {
  const std::vector<V4l2Device> devices = list_v4l2_devices();
  for (const V4l2Pair& pair : pair_v4l2_devices(devices)) {
    found.push_back({"v4l2:" + pair.colour->path + "," + pair.depth->path,
                     pair.colour->card + " with depth of " + pair.depth->card});
  }
  for (const V4l2Device& device : devices) {
    found.push_back({"", device.path + ": " + device.card + (device.as_colour > 0 ? ", colour" : "") +
                             (device.as_depth > 0 ? ", depth" : "")});
  }
}
#endif

#ifdef STILLMAP_HAS_OPENNI2
Result<OpenedSource> open_openni2(const std::string& uri, const std::string& device, const Config& config) {
  Result<CameraModule*> module = open_driver_module("openni2");
  if (!module.ok()) return module.error();
  const Paired::Setup setup = pair_setup(uri, config);
  const CameraRequest request{.device = device,
                              .width = config.camera.width,
                              .height = config.camera.height,
                              .fps = config.mount.fps,
                              .colour_format = config.device.colour_format,
                              .depth_units_per_m = config.camera.depth_units_per_m,
                              .register_depth = !setup.depth_lens};
  const auto make = [setup, request, cameras = module.value()] {
    StreamPair streams = cameras->make(request);
    return std::make_unique<Paired>(setup, std::move(streams.colour), std::move(streams.depth));
  };
  if (!device.ends_with(".oni")) return open_camera(make, config);
  std::error_code unknown;
  if (!std::filesystem::is_regular_file(device, unknown))  // a pipe would keep it waiting
    return Error{ExitCode::UnreadableInput, uri + ": is not there, or no regular file"};
  OpenedSource source;
  source.driver = make();
  if (Status s = source.driver->open(); !s.ok()) return s.error();
  return source;
}
#endif

#ifdef STILLMAP_HAS_LIBCAMERA
/// The first of the video nodes that serve best as depth; empty without any.
std::string best_depth_node() {
  const std::vector<V4l2Device> devices = list_v4l2_devices();
  const auto best = std::ranges::max_element(devices, {}, &V4l2Device::as_depth);
  return best == devices.end() || best->as_depth == 0 ? "" : best->path;
}

Result<OpenedSource> open_libcamera(const std::string& uri, const std::string& rest, const Config& config) {
  const std::size_t comma = rest.rfind(",/dev/");  // an ID may have a comma of its own
  const std::string node = comma == std::string::npos ? best_depth_node() : rest.substr(comma + 1);
  if (node.empty()) {
    return Error{ExitCode::WrongConfig,
                 "--source " + uri +
                     ": there is no video node with depth to go with it; plug a depth camera in, or name its "
                     "node: libcamera:ID,/dev/videoN (`stillmap devices` lists them)"};
  }
  Result<CameraModule*> module = open_driver_module("libcamera");
  if (!module.ok()) return module.error();
  const Paired::Setup setup = pair_setup(uri, config);
  const CameraRequest colour{.device = rest.substr(0, comma),
                             .width = config.camera.width,
                             .height = config.camera.height,
                             .fps = config.mount.fps,
                             .colour_format = config.device.colour_format};
  return open_camera(
      [setup, colour, depth = depth_request(node, setup, config), cameras = module.value()] {
        return std::make_unique<Paired>(setup, cameras->make(colour).colour,
                                        std::make_unique<V4l2Stream>(depth));
      },
      config);
}

void find_libcamera(std::vector<FoundSource>& found) {
  Result<CameraModule*> module = open_driver_module("libcamera");
  if (!module.ok()) return;
  const std::string depth = best_depth_node();
  for (const FoundCamera& camera : module.value()->list()) {
    const std::string uri = "libcamera:" + camera.device;
    found.push_back(
        depth.empty() ? FoundSource{"", uri + ": " + camera.description + ", colour; needs a node with depth"}
                      : FoundSource{uri + "," + depth, camera.description + " with depth of " + depth});
  }
}
#endif

}  // namespace

Result<OpenedSource> open_source(const std::string& uri, const Config& config, int loops) {
  const std::size_t colon = uri.find(':');
  const std::string scheme = uri.substr(0, colon);
  const std::string rest = colon == std::string::npos ? "" : uri.substr(colon + 1);
  if (colon != std::string::npos) {
    if (scheme == "tum") return open_log(uri, config, loops);
    if (loops > 1) {
      return Error{ExitCode::WrongConfig, "--loop " + std::to_string(loops) + ": " + uri +
                                              " can be played once only; --loop is for tum:DIR"};
    }
#ifdef STILLMAP_HAS_V4L2
    if (scheme == "v4l2") return open_v4l2(uri, rest, config);
#endif
#ifdef STILLMAP_HAS_OPENNI2
    if (scheme == "openni2") return open_openni2(uri, rest, config);
#endif
#ifdef STILLMAP_HAS_LIBCAMERA
    if (scheme == "libcamera") return open_libcamera(uri, rest, config);
#endif
  }
  return Error{ExitCode::WrongConfig,
               "--source " + uri +
                   ": expected tum:DIR (a folder in the TUM RGB-D layout), "
                   "v4l2:COLOUR,DEPTH, openni2:[URI|FILE.oni] or libcamera:ID[,DEPTH]; this program has " +
                   source_kinds() + meant_source(uri)};
}

Result<std::string> log_folder(const std::string& uri) {
  if (!uri.starts_with(kTum))
    return Error{ExitCode::WrongConfig,
                 "--source " + uri + ": expected tum:DIR, the log that was played" + meant_source(uri)};
  std::string path = uri.substr(std::strlen(kTum));
  if (path.empty())
    return Error{ExitCode::WrongConfig,
                 "--source tum:: names no folder; give the one that holds rgb.txt and depth.txt"};
  std::error_code unknown;
  if (std::filesystem::is_regular_file(path, unknown))
    return Error{ExitCode::UnreadableInput, path +
                                                ": is a file; give the folder that holds it: --source tum:" +
                                                std::filesystem::absolute(path).parent_path().string()};
  return path;
}

std::string meant_source(const std::string& word) {
  std::error_code unknown;
  const bool whole = std::ranges::any_of(std::array{kTum, kV4l2, kOpenni2, kLibcamera},
                                         [&](const char* kind) { return word.starts_with(kind); });
  if (!whole && !std::filesystem::is_directory(word, unknown)) return "";
  return "; did you mean `--source " + (whole ? word : kTum + word) + "`?";
}

std::vector<FoundSource> find_sources() {
  std::vector<FoundSource> found;
#ifdef STILLMAP_HAS_OPENNI2
  if (Result<CameraModule*> module = open_driver_module("openni2"); module.ok()) {
    for (const FoundCamera& camera : module.value()->list())
      found.push_back({"openni2:" + camera.device, camera.description});
  }
#endif
#ifdef STILLMAP_HAS_V4L2
  find_v4l2(found);
#endif
#ifdef STILLMAP_HAS_LIBCAMERA
  find_libcamera(found);
#endif
  return found;
}

std::string source_kinds() {
  std::string kinds = "tum";
#ifdef STILLMAP_HAS_V4L2
  kinds += ", v4l2";
#endif
#ifdef STILLMAP_HAS_OPENNI2
  kinds += ", openni2";
#endif
#ifdef STILLMAP_HAS_LIBCAMERA
  kinds += ", libcamera";
#endif
  return kinds;
}

NominalProfile nominal_profile(const std::string& uri) {
  constexpr int kWidth = 640, kHeight = 480;
  NominalProfile profile{{"camera.name=nominal", "camera.width=" + std::to_string(kWidth),
                          "camera.height=" + std::to_string(kHeight), "camera.cx=319.5", "camera.cy=239.5",
                          "camera.depth_units_per_m=1000"},
                         ""};
  const auto set_focal = [&](double fx, double fy) {
    profile.overrides.push_back("camera.fx=" + std::to_string(fx));
    profile.overrides.push_back("camera.fy=" + std::to_string(fy));
  };
  std::optional<DeviceLens> lens;
#ifdef STILLMAP_HAS_OPENNI2
  if (uri.starts_with(kOpenni2)) {
    if (Result<CameraModule*> module = open_driver_module("openni2"); module.ok())
      lens = module.value()->lens(
          {.device = uri.substr(std::strlen(kOpenni2)), .width = kWidth, .height = kHeight});
  }
#endif
  if (lens) {
    set_focal(lens->fx, lens->fy);
    profile.warning = "no camera profile: the lens is as the camera tells it (fx " +
                      std::to_string(std::lround(lens->fx)) + ", fy " +
                      std::to_string(std::lround(lens->fy)) +
                      " px), with its centre and no distortion assumed; calibrating it "
                      "(scripts/import_calibration.py) is better";
    return profile;
  }
  // 57 degrees across, as PrimeSense's cameras have it; a RealSense D4xx at 640x480 has 55.
  const double f = uri.starts_with(kOpenni2) ? 570 : 615;
  set_focal(f, f);
  profile.warning =
      "no camera profile, and the camera tells nothing of its lens: a nominal one is assumed, and the map's "
      "scale may be "
      "off by some percent; give --config with a file of firmware-config/cameras, or calibrate";
  return profile;
}

}  // namespace stillmap
