// SPDX-License-Identifier: Apache-2.0
#include "runtime/saved_map.h"

#include <spdlog/fmt/fmt.h>

#include <span>
#include <vector>

#include "map/ply.h"
#include "runtime/run_plan.h"

namespace stillmap {

MapFacts map_facts(const Config& config) {
  // The map begins at the base, whose z axis points up.
  return {config.map.voxel_m, calibration_hash(config.camera), config.mount.T_base_camera.has_value()};
}

Result<MapFile> read_resumed(const RunOptions& o, const Config& config) {
  const std::string& path = o.resume;
  Result<MapFile> map = read_map_file(path);
  if (!map.ok()) return map;
  const auto wrong = [&](const std::string& what) {
    return Error{ExitCode::WrongConfig, "--resume " + path + ": " + what};
  };
  const MapFacts &its = map.value().facts, own = map_facts(config);
  if (its.camera_hash != own.camera_hash)
    return wrong(
        "was mapped with another camera calibration; run with the camera file that it was mapped with");
  if (its.voxel_m != own.voxel_m)
    return wrong(fmt::format("has voxels of {:g} m, map.voxel_m is {:g} m; add --set map.voxel_m={:g}",
                             its.voxel_m, own.voxel_m, its.voxel_m));
  if (its.z_is_up != own.z_is_up)
    return wrong(its.z_is_up ? "was mapped with camera.T_base_camera set; set it as it was"
                             : "was mapped without camera.T_base_camera; leave it out");
  const std::size_t blocks = map.value().blocks->blocks_used(), kept = kept_blocks(o, config);
  if (blocks > static_cast<std::size_t>(config.map.capacity_voxels / kBlockVoxels) + kept)
    return wrong(fmt::format("holds {} blocks; raise map.capacity_voxels to {} or more{}", blocks,
                             (blocks - kept) * kBlockVoxels,
                             is_map_file(o.map) ? fmt::format(", or map.kept_blocks to {}", blocks) : ""));
  return map;
}

Status resume(const std::string& path, const MapFile& map, Stages& stages) {
  if (Status s = stages.track.resume(map.keyframes); !s.ok())
    return Error{s.error().exit_code, "--resume " + path + ": " + s.error().message};
  STILLMAP_CHECK(stages.map.resume(*map.blocks, stages.track.tracker().local_map().keyframes()));
  return {};
}

Status write_map(const std::string& path, const Config& config, Stages& stages, EarlierFile& earlier) {
  const auto timeout_ns = static_cast<Nanoseconds>(config.map.save_timeout_s * 1e9);
  const VoxelMap& map = stages.map.map();
  if (!is_map_file(path)) return write_ply(map.blocks(), map.voxel_m(), path, timeout_ns, &earlier);
  MapFileWriter file(path, map_facts(config), timeout_ns, &earlier);
  append_blocks(map.blocks(), file);
  stages.map.kept().append_to(file);
  const LocalMap& local_map = stages.track.tracker().local_map();
  std::vector<std::byte> bytes(KeyframeWriter::kLargestRecord);
  for (KeyframeWriter keyframes; !keyframes.done(local_map);) {
    const std::size_t size = keyframes.write(local_map, stages.track.T_map_odom(), bytes);
    file.append_keyframes(std::span(bytes).first(size));
  }
  return file.finish();
}

}  // namespace stillmap
