// SPDX-License-Identifier: Apache-2.0
#include "runtime/source.h"

#include <utility>

#include "drivers/paired/paired.h"
#include "drivers/tum_log/tum_log.h"
#include "runtime/driver_module.h"
#include "runtime/reopening_source.h"

#ifdef STILLMAP_HAS_V4L2
#include "drivers/v4l2/v4l2_stream.h"
#endif

namespace stillmap {

namespace {

Paired::Setup pair_setup(const std::string& uri, const Config& config) {
  Paired::Setup setup{.name = uri, .colour = config.camera, .fps = config.mount.fps};
  if (config.device.depth.width > 0) {
    setup.depth_lens = config.device.depth;
    setup.T_colour_depth = pose_from(*config.device.T_colour_depth);
  }
  return setup;
}

Result<OpenedSource> open_log(const std::string& folder, const Config& config, int loops) {
  auto log = std::make_unique<TumLog>(folder, config.camera.width, config.camera.height, loops);
  if (Status s = log->open(); !s.ok()) return s.error();
  OpenedSource source;
  source.stamps.assign(log->colour_stamps().begin(), log->colour_stamps().end());
  source.driver = std::move(log);
  return source;
}

/// A recording ends, and cannot be opened anew in its middle; a camera can.
Result<OpenedSource> open_camera(const ReopeningSource::Factory& make, const Config& config) {
  OpenedSource source;
  source.events = std::make_unique<EventRing>();
  source.driver = std::make_unique<ReopeningSource>(
      make, ReopeningSource::Patience{config.device.stall_s, config.device.give_up_s}, *source.events);
  if (Status s = source.driver->open(); !s.ok()) return s.error();
  return source;
}

#ifdef STILLMAP_HAS_V4L2
Result<OpenedSource> open_v4l2(const std::string& uri, const std::string& nodes, const Config& config) {
  const std::size_t comma = nodes.find(',');
  if (comma == std::string::npos || comma == 0 || comma + 1 == nodes.size()) {
    return Error{ExitCode::WrongConfig, "--source " + uri +
                                            ": expected v4l2:COLOUR,DEPTH, two video nodes such as "
                                            "/dev/video4,/dev/video2; `stillmap devices` lists them"};
  }
  const Paired::Setup setup = pair_setup(uri, config);
  const CameraModel& depth_lens = setup.depth_lens ? *setup.depth_lens : config.camera;
  const V4l2Request colour{.device = nodes.substr(0, comma),
                           .depth = false,
                           .width = config.camera.width,
                           .height = config.camera.height,
                           .fps = config.mount.fps,
                           .format = config.device.colour_format,
                           .controls = config.device.colour_controls};
  const V4l2Request depth{.device = nodes.substr(comma + 1),
                          .depth = true,
                          .width = depth_lens.width,
                          .height = depth_lens.height,
                          .fps = config.mount.fps,
                          .format = config.device.depth_format,
                          .controls = config.device.depth_controls};
  return open_camera(
      [setup, colour, depth] {
        return std::make_unique<Paired>(setup, std::make_unique<V4l2Stream>(colour),
                                        std::make_unique<V4l2Stream>(depth));
      },
      config);
}

/// The first node with depth makes a camera with the first other one with colour, on the same plug if it can.
void find_v4l2(std::vector<FoundSource>& found) {
  const std::vector<V4l2Device> devices = list_v4l2_devices();
  for (const V4l2Device& depth : devices) {
    if (!depth.depth) continue;
    const V4l2Device* partner = nullptr;
    for (const V4l2Device& colour : devices) {
      if (!colour.colour || colour.path == depth.path) continue;
      if (partner == nullptr || (partner->bus != depth.bus && colour.bus == depth.bus)) partner = &colour;
    }
    if (partner == nullptr) continue;
    found.push_back(
        {"v4l2:" + partner->path + "," + depth.path, partner->card + " with depth of " + depth.card});
  }
  for (const V4l2Device& device : devices) {
    found.push_back({"", device.path + ": " + device.card + (device.colour ? ", colour" : "") +
                             (device.depth ? ", depth" : "")});
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
                              .depth_units_per_m = config.camera.depth_units_per_m,
                              .register_depth = !setup.depth_lens};
  const auto make = [setup, request, cameras = module.value()] {
    StreamPair streams = cameras->make(request);
    return std::make_unique<Paired>(setup, std::move(streams.colour), std::move(streams.depth));
  };
  if (!device.ends_with(".oni")) return open_camera(make, config);
  OpenedSource source;
  source.driver = make();
  if (Status s = source.driver->open(); !s.ok()) return s.error();
  return source;
}
#endif

}  // namespace

Result<OpenedSource> open_source(const std::string& uri, const Config& config, int loops) {
  const std::size_t colon = uri.find(':');
  const std::string scheme = uri.substr(0, colon);
  const std::string rest = colon == std::string::npos ? "" : uri.substr(colon + 1);
  if (colon != std::string::npos) {
    if (scheme == "tum") return open_log(rest, config, loops);
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
  }
  return Error{ExitCode::WrongConfig, "--source " + uri +
                                          ": expected tum:DIR (a folder in the TUM RGB-D layout), "
                                          "v4l2:COLOUR,DEPTH or openni2:[URI|FILE.oni]; this program has " +
                                          source_kinds()};
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
  return kinds;
}

std::vector<std::string> nominal_profile(const std::string& uri) {
  // 57 degrees across, as PrimeSense's cameras have it; a RealSense D4xx at 640x480 has 55.
  const std::string f = uri.starts_with("openni2:") ? "570" : "615";
  return {"camera.name=nominal", "camera.width=640", "camera.height=480", "camera.fx=" + f,
          "camera.fy=" + f,      "camera.cx=319.5",  "camera.cy=239.5",   "camera.depth_units_per_m=1000"};
}

}  // namespace stillmap
