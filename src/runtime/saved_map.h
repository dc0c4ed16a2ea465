// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/config.h"
#include "core/status.h"
#include "map/map_file.h"
#include "runtime/run_options.h"
#include "runtime/stages.h"

namespace stillmap {

/// Whether a path names the project's own map format.
inline bool is_map_file(const std::string& path) {
  return path.ends_with(".stillmap");
}
MapFacts map_facts(const Config& config);

/// The map file to go on in (`--resume`), where it fits this configuration. The error names both.
Result<MapFile> read_resumed(const RunOptions& options, const Config& config);

/// Fills the stages with a map that `read_resumed` has let through, before the first frame.
Status resume(const std::string& path, const MapFile& map, Stages& stages);

/// Writes the map when every stage has ended, in the format that the name's ending says (.stillmap or .ply).
/// `earlier` is what becomes of the file that it replaces.
Status write_map(const std::string& path, const Config& config, Stages& stages, EarlierFile& earlier);

}  // namespace stillmap
