// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/config.h"
#include "core/status.h"
#include "drivers/rgbd_driver.h"

namespace stillmap {

struct OpenedSource {
  std::unique_ptr<RgbdDriver> driver;
  std::vector<Nanoseconds> stamps;  ///< colour stamps of all frames that a log offers; empty for a camera
};

/// Opens what a source URI names: `tum:DIR`.
Result<OpenedSource> open_source(const std::string& uri, const Config& config);

}  // namespace stillmap
