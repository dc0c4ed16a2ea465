// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/cloud_point.h"
#include "core/detection.h"
#include "core/dynamic_mask.h"
#include "core/fixed_vector.h"
#include "core/geometry.h"
#include "core/image.h"
#include "core/time.h"

namespace stillmap {

/// Where the robot is, for clients: the chain map -> odom -> base -> camera of one frame. Only frames that
/// have a pose are published. Translations in metres; the stamp is on the source's clock and goes out as it
/// is.
struct StreamPose {
  Nanoseconds stamp_ns = 0;
  Pose T_map_odom{}, T_odom_base{}, T_base_camera{};
  std::uint32_t epoch = 0;  ///< corrections so far; T_map_odom is of this one
};

/// The most points that one cloud holds; a bigger map is coarsened by its owner.
constexpr std::size_t kMaxCloudPoints = 200'000;

/// A moving or semi-static thing on one frame.
struct StreamObject {
  std::uint32_t id = 0;
  std::uint16_t class_id = 0;  ///< index into `classes.names`
  ClassKind kind = ClassKind::Ignored;
  float score = 0;
  Box box{};                    ///< in pixels of the full picture
  float near_m = 0, far_m = 0;  ///< its depth interval; 0: unknown, then it has no place in space
  Vec3 velocity_m_s{};          ///< in the map frame
  Nanoseconds age_ns = 0;       ///< since it was first found
};

/// A feature of one frame, in whole pixels of the full picture.
struct StreamFeature {
  std::uint16_t x = 0, y = 0;
  Label label = Label::Unknown;
};

/// What was seen on one frame.
struct StreamScene {
  std::uint64_t sequence = 0;
  Nanoseconds stamp_ns = 0;
  bool has_pose = false;
  Pose T_map_camera;  ///< meaningful with a pose
  FixedVector<StreamObject, 64> objects;
  FixedVector<StreamFeature, 1200> features;
};

/// The occupied voxels of one block of the map, as docs/stream.md describes them.
struct StreamBlock {
  static constexpr std::size_t kVoxels = 512;
  std::uint32_t slot = 0;
  std::int32_t x = 0, y = 0, z = 0;  ///< in whole blocks
  std::array<std::uint8_t, kVoxels / 8> occupied{};
  std::array<std::uint8_t, 3 * kVoxels> colours{};  ///< red, green, blue of each occupied voxel
  std::size_t count = 0;                            ///< occupied voxels
};

/// How the runtime does, for /health.
struct StreamHealth {
  const char* state = "";
  double uptime_s = 0, fps = 0, latency_ms = 0;
  std::uint64_t frames_offered = 0, frames_processed = 0, frames_dropped = 0, frames_lost = 0, keyframes = 0,
                detector_runs = 0, rss_bytes = 0, map_blocks = 0, map_blocks_capacity = 0;
};

enum class LogLevel : std::uint8_t { Info = 2, Warning = 3, Error = 4 };  ///< the numbers of foxglove.Log

/// What the stream has done since start.
struct StreamStats {
  std::uint64_t clients = 0;            ///< connected now
  std::uint64_t clients_peak = 0;       ///< most at once
  std::uint64_t clients_refused = 0;    ///< turned away because `stream.max_clients` were there
  std::uint64_t clients_unwelcome = 0;  ///< turned away for their token, origin or host
  std::uint64_t clients_given_up = 0;   ///< closed because they stopped reading in the middle of a cloud, or
                                        ///< sent too much
  std::uint64_t messages_sent = 0;      ///< over WebSocket, to all clients together
  std::uint64_t messages_dropped = 0;   ///< that a slow client never got
  std::uint64_t bytes_sent = 0;         ///< payload of WebSocket messages and HTTP bodies
  std::uint64_t bad_messages = 0;       ///< from clients: malformed, unknown, too large
  std::uint64_t poses_refused = 0;      ///< published while the stream thread was far behind
  std::uint64_t pictures_sent = 0;      ///< previews encoded
  std::uint64_t pictures_withheld = 0;  ///< previews that did not leave because what is in them was unknown
};

}  // namespace stillmap
