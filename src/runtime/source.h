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
  std::vector<Nanoseconds> stamps;  ///< colour stamps of a log's first pass; empty for a camera
};

/// Opens what a source URI names: `tum:DIR`. A log is played `loops` times, forwards and backwards in turn.
Result<OpenedSource> open_source(const std::string& uri, const Config& config, int loops);

}  // namespace stillmap
