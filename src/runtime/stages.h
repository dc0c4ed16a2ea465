// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "core/arena.h"
#include "core/config.h"
#include "core/frame_pool.h"
#include "eval/trajectory.h"
#include "runtime/final_trajectory.h"
#include "runtime/flight_recorder.h"
#include "runtime/frame_budget.h"
#include "runtime/map_stage.h"
#include "runtime/track_stage.h"
#include "stream/stream_server.h"

namespace stillmap {

/// Everything that takes memory for the length of a run, built once. Built over a planning arena it takes
/// nothing and leaves the plan behind.
struct Stages {
  struct Parts {
    bool detector = false, stream = false;
    bool log = true;         ///< the source is one, and is decoded ahead
    int lockstep_delay = 0;  ///< frames that lockstep keeps for a late detector
    int recorder_frames = 0;
    std::size_t trajectory_poses = 0;
    std::size_t kept_blocks = 0;  ///< evicted ones, for a map file
    bool final_trajectory = false;
    bool groundtruth = false;  ///< there will be one to compare with

    FrameBudget frames() const {
      return frame_budget({.detector = detector,
                           .log = log,
                           .recorder = static_cast<std::size_t>(recorder_frames),
                           .lockstep_delay = static_cast<std::size_t>(lockstep_delay)});
    }
  };
  Stages(Arena& arena, const Config& config, const Parts& parts)
      : frames(arena, parts.frames().sum(), config.camera.width, config.camera.height),
        rays(arena, config.camera),
        track(arena, config),
        map(arena, config, rays, parts.detector, parts.kept_blocks),
        flight(arena.take<FlightFrame>(
            "flight_recorder",
            config.runtime.flight_recorder.empty() ? 0 : FlightRecorder::frames_for(config.mount.fps))),
        trajectory(arena.take<StampedPose>("trajectory", parts.trajectory_poses)),
        covariances(arena.take<std::array<double, 36>>("trajectory.covariances",
                                                       parts.groundtruth ? parts.trajectory_poses : 0)),
        final_trajectory(arena, parts.final_trajectory ? parts.trajectory_poses : 0) {
    if (parts.stream) stream.emplace(config, arena);
  }

  FramePool frames;
  RayTable rays;
  TrackStage track;
  MapStage map;
  std::span<FlightFrame> flight;
  std::span<StampedPose> trajectory;              ///< room for what the run's outputs tell of its poses
  std::span<std::array<double, 36>> covariances;  ///< beside `trajectory`
  FinalTrajectory final_trajectory;
  std::optional<StreamServer> stream;
};

}  // namespace stillmap
