// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/status.h"
#include "drivers/camera_module.h"

namespace stillmap {

/// Opens libstillmap_driver_NAME.so, from beside the program or the system's library folders, once; it stays
/// open. The error says why it could not be. Main thread.
Result<CameraModule*> open_driver_module(const std::string& name);

}  // namespace stillmap
