// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <filesystem>
#include <memory>

#include "app/commands.h"
#include "map/map_file.h"
#include "map/occupancy_image.h"
#include "map/octomap.h"
#include "map/ply.h"
#include "track/keyframe_file.h"

namespace stillmap {

namespace {

struct ExportOptions {
  std::string file, out;
  double from_m = 0.1, to_m = 1.8;
};

Status print_info(const MapFile& map, const std::string& path) {
  const BlockTable& blocks = *map.blocks;
  const Result<KeyframeCounts> counts = count_keyframes(map.keyframes);
  if (!counts.ok()) return Error{counts.error().exit_code, path + ": " + counts.error().message};
  std::printf(
      "file         %s\nvoxels       %llu occupied, of %.6g m\nblocks       %d of 8 x 8 x 8 voxels\n"
      "keyframes    %zu with %zu points\ncalibration  %016llx\nup           %s\n",
      path.c_str(), static_cast<unsigned long long>(blocks.occupied_voxels()), map.facts.voxel_m,
      blocks.size(), counts.value().keyframes, counts.value().points,
      static_cast<unsigned long long>(map.facts.camera_hash), map.facts.z_is_up ? "z" : "unknown");
  return {};
}

Status info(const std::string& path) {
  const Result<MapFile> map = read_map_file(path);
  if (!map.ok()) return map.error();
  return print_info(map.value(), path);
}

Status export_map(const ExportOptions& o) {
  const bool ply = o.out.ends_with(".ply"), tree = o.out.ends_with(".bt");
  if (!ply && !tree && !o.out.ends_with(".pgm"))
    return Error{ExitCode::WrongConfig,
                 "--out " + o.out + ": expected a file name that ends in .ply, .bt or .pgm"};
  std::error_code unknown;
  if (std::filesystem::equivalent(o.file, o.out, unknown))
    return Error{ExitCode::WrongConfig, "--out " + o.out + ": is the map itself; give it another name"};
  const Result<MapFile> map = read_map_file(o.file);
  if (!map.ok()) return map.error();
  const double voxel_m = map.value().facts.voxel_m;
  if (ply) return write_ply(*map.value().blocks, voxel_m, o.out);
  if (tree) {
    Status written = write_octomap(*map.value().blocks, voxel_m, o.out);
    if (!written.ok() && written.error().exit_code == ExitCode::WrongConfig)
      return Error{ExitCode::WrongConfig, o.file + ": " + written.error().message};
    return written;
  }
  const Result<OccupancyImage> image = occupancy_image(map.value(), o.from_m, o.to_m);
  if (!image.ok()) return Error{image.error().exit_code, o.file + ": " + image.error().message};
  return write_occupancy_image(image.value(), voxel_m, o.out);
}

}  // namespace

void add_map_command(CLI::App& app, Action& action) {
  CLI::App* map_app = app.add_subcommand("map", "Look into a .stillmap file, or turn it into another format");
  map_app->require_subcommand(1);
  const auto o = std::make_shared<ExportOptions>();

  CLI::App* info_app = map_app->add_subcommand("info", "What the file holds");
  info_app->add_option("FILE", o->file, ".stillmap file")->required();
  info_app->callback([o, &action] { action = [o] { return info(o->file); }; });

  CLI::App* export_app = map_app->add_subcommand(
      "export",
      "Points as .ply, an OctoMap tree as .bt, or a floor plan as .pgm with .yaml (ROS map_server)");
  export_app->add_option("FILE", o->file, ".stillmap file")->required();
  export_app->add_option("--out", o->out, "File that ends in .ply, .bt or .pgm")->required();
  export_app->add_option("--from", o->from_m, "Floor plan: lowest height that counts, m");
  export_app->add_option("--to", o->to_m, "Floor plan: greatest height that counts, m");
  export_app->callback([o, &action] { action = [o] { return export_map(*o); }; });
}

}  // namespace stillmap
