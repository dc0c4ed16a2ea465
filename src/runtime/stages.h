// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "core/arena.h"
#include "core/config.h"
#include "core/frame_pool.h"
#include "runtime/block_feed.h"
#include "runtime/map_stage.h"
#include "runtime/track_stage.h"
#include "stream/stream_server.h"

namespace stillmap {

/// Everything that takes memory for the length of a run, built once. Built over a planning arena it takes
/// nothing and leaves the plan behind.
struct Stages {
  struct Parts {
    bool detector = false, stream = false;
    int extra_frames = 0;  ///< beyond runtime.frame_pool: what lockstep keeps for a late detector
  };
  Stages(Arena& arena, const Config& config, const Parts& parts)
      : frames(arena,
               static_cast<std::size_t>(config.runtime.frame_pool + parts.extra_frames +
                                        (parts.stream ? StreamServer::kFramesHeld : 0)),
               config.camera.width, config.camera.height),
        rays(arena, config.camera),
        track(arena, config),
        map(arena, config, rays, parts.detector) {
    if (!parts.stream) return;
    stream.emplace(config, arena);
    block_feed.emplace(arena, static_cast<std::size_t>(config.map.capacity_voxels / kBlockVoxels));
  }

  FramePool frames;
  RayTable rays;
  TrackStage track;
  MapStage map;
  std::optional<StreamServer> stream;
  std::optional<BlockFeed> block_feed;  ///< with the stream
};

}  // namespace stillmap
