// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/picture_stream.h"

namespace stillmap {

/// What a camera with its own library is asked for.
struct CameraRequest {
  std::string device;  ///< the source's name after the scheme; empty: the first that is found
  int width = 0, height = 0;
  double fps = 30;
  std::string colour_format{};  ///< as `name_of` calls it; empty: the best that the device has
  double depth_units_per_m = 1000;
  bool register_depth = true;  ///< by the device; without it, depth comes as its own camera sees it
};

/// Colour and depth of one camera; depth is null where the module's cameras have none. Each keeps alive what
/// both share.
struct StreamPair {
  std::unique_ptr<PictureStream> colour, depth;
};

struct FoundCamera {
  std::string device, description;
};

/// Focal lengths in pixels of the requested size.
struct DeviceLens {
  double fx = 0, fy = 0;
};

/// A driver that lives in a library of its own, libstillmap_driver_NAME.so, so that the runtime does not
/// depend on the camera's library. Main thread.
class CameraModule {
 public:
  virtual ~CameraModule() = default;
  virtual StreamPair make(const CameraRequest& request) = 0;
  /// The colour camera's lens as the device itself tells it, an ideal pinhole; nothing where it does not, or
  /// where it cannot be opened so. Opens the device for a moment.
  virtual std::optional<DeviceLens> lens(const CameraRequest& request) = 0;
  virtual std::vector<FoundCamera> list() = 0;
};

/// The module's one entry. Program and module come from one build.
constexpr const char* kCameraModuleEntry = "stillmap_camera_module";
using CameraModuleEntry = CameraModule* (*)();

}  // namespace stillmap
