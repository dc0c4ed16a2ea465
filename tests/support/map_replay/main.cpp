// SPDX-License-Identifier: Apache-2.0
// Maps a log with given poses instead of the tracker's own, so that the map's faults are the map's alone:
//
//   stillmap-map-replay CONFIG LOG_DIR POSES OUT.ply [KEY=VALUE ...]
//
// POSES: a trajectory in TUM format, e.g. the log's groundtruth.txt; the map is in its frame. Boxes are
// found, carried and made into masks as a run does it; every frame has its own.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>

#include "detect/box_carrier.h"
#include "detect/detector.h"
#include "detect/model_file.h"
#include "eval/trajectory.h"
#include "map/ply.h"
#include "runtime/source.h"
#include "runtime/stages.h"
#include "segment/segment.h"

namespace stillmap {
namespace {

/// Nothing where the poses beside the stamp are more than 50 ms apart.
std::optional<Pose> pose_at(const std::vector<StampedPose>& poses, Nanoseconds stamp_ns) {
  const auto after = std::lower_bound(poses.begin(), poses.end(), stamp_ns,
                                      [](const StampedPose& p, Nanoseconds ns) { return p.stamp_ns < ns; });
  if (after == poses.begin() || after == poses.end()) return std::nullopt;
  const StampedPose& before = *std::prev(after);
  const Nanoseconds gap_ns = after->stamp_ns - before.stamp_ns;
  if (gap_ns > 50'000'000) return std::nullopt;
  return interpolate(before.T_world_camera, after->T_world_camera,
                     to_seconds(stamp_ns - before.stamp_ns) / to_seconds(gap_ns));
}

/// The part of the tracker that the map needs, with the poses given.
struct Replay {
  const Config& config;
  const std::vector<StampedPose>& poses;
  Detector* detector;
  Stages& stages;
  BoxCarrier carrier{config.camera, config.detector};
  Detections boxes{}, carried{};
  int unposed = 0;

  void take(FrameHandle frame) {
    const std::optional<Pose> T_map_colour = pose_at(poses, frame->colour_ns),
                              T_map_depth = pose_at(poses, frame->depth_ns);
    if (!T_map_colour || !T_map_depth) {
      ++unposed;
      return;
    }
    PosedFrame posed;
    posed.T_map_colour = *T_map_colour;
    posed.T_map_depth = *T_map_depth;
    posed.boxes_are_its_own = detector != nullptr && detector->run(*frame, boxes);
    if (posed.boxes_are_its_own) {
      measure_depths(boxes, frame->depth, config.camera);
      carrier.update(boxes, *T_map_colour);
    }
    carrier.carry(frame->colour_ns, *T_map_colour, carried);
    carried.sequence = frame->sequence;
    segment(carried, frame->depth, config.camera, config.track.dynamic_rule, posed.mask);
    posed.sequence = frame->sequence;
    posed.stamp_ns = frame->colour_ns;
    posed.frame = std::move(frame);
    stages.map.take_frame(std::move(posed));
  }
};

Status replay(const std::string& config_path, const std::string& log, const std::string& poses_path,
              const std::string& out, const std::vector<std::string>& overrides) {
  const Result<LoadedConfig> loaded = load_config_of_model(std::vector{config_path}, overrides);
  if (!loaded.ok()) return loaded.error();
  const Config& config = loaded.value().config;
  const Result<std::vector<StampedPose>> poses = read_trajectory(poses_path);
  if (!poses.ok()) return poses.error();
  Result<OpenedSource> source = open_source("tum:" + log, config, 1);
  if (!source.ok()) return source.error();
  Result<ModelFile> model = find_model(config.detector);
  if (!model.ok()) return model.error();
  std::unique_ptr<Detector> detector;
  if (!model.value().path.empty()) {
    Result<std::unique_ptr<Detector>> opened = Detector::open(config, model.value());
    if (!opened.ok()) return opened.error();
    detector = std::move(opened.value());
  }
  const Stages::Parts parts{.detector = detector != nullptr};
  Arena planning;
  { const auto planned = std::make_unique<Stages>(planning, config, parts); }
  Arena arena(planning.bytes_planned());
  const auto stages = std::make_unique<Stages>(arena, config, parts);
  RgbdDriver& driver = *source.value().driver;
  if (Status s = driver.start(); !s.ok()) return s;

  const auto state = std::make_unique<Replay>(Replay{config, poses.value(), detector.get(), *stages});
  std::uint64_t sequence = 0;
  for (GrabStatus grabbed = GrabStatus::Frame; grabbed != GrabStatus::EndOfStream;) {
    FrameHandle frame = stages->frames.acquire();
    grabbed = driver.grab(frame.writable(), 0).status;
    if (grabbed != GrabStatus::Frame) continue;
    frame.writable().sequence = sequence++;
    state->take(std::move(frame));
  }
  const VoxelMap& map = stages->map.map();
  std::printf(
      "%llu frames fused, %d without a pose, %llu voxels, point reduction %.1f, %llu blocks evicted\n",
      static_cast<unsigned long long>(map.fused_frames()), state->unposed,
      static_cast<unsigned long long>(map.occupied_voxels()), map.point_reduction(),
      static_cast<unsigned long long>(map.blocks_evicted()));
  return write_ply(map.blocks(), map.voxel_m(), out);
}

}  // namespace
}  // namespace stillmap

int main(int argc, char** argv) {
  if (argc < 5) {
    std::fprintf(stderr, "usage: stillmap-map-replay CONFIG LOG_DIR POSES OUT.ply [KEY=VALUE ...]\n");
    return 2;
  }
  const stillmap::Status status =
      stillmap::replay(argv[1], argv[2], argv[3], argv[4], {argv + 5, argv + argc});
  if (!status.ok()) std::fprintf(stderr, "stillmap-map-replay: %s\n", status.error().message.c_str());
  return status.ok() ? 0 : static_cast<int>(status.error().exit_code);
}
