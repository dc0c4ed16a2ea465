// SPDX-License-Identifier: Apache-2.0
#include "runtime/source.h"

#include "drivers/tum_log/tum_log.h"

namespace stillmap {

Result<OpenedSource> open_source(const std::string& uri, const Config& config, int loops) {
  const std::size_t colon = uri.find(':');
  const std::string scheme = uri.substr(0, colon);
  if (colon == std::string::npos || scheme != "tum") {
    return Error{ExitCode::WrongConfig,
                 "--source " + uri + ": expected tum:DIR, a folder in the TUM RGB-D layout"};
  }
  auto log =
      std::make_unique<TumLog>(uri.substr(colon + 1), config.camera.width, config.camera.height, loops);
  if (Status s = log->open(); !s.ok()) return s.error();
  OpenedSource source;
  source.stamps.assign(log->colour_stamps().begin(), log->colour_stamps().end());
  source.driver = std::move(log);
  return source;
}

}  // namespace stillmap
