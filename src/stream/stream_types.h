// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/cloud_point.h"
#include "core/geometry.h"
#include "core/time.h"

namespace stillmap {

/// Where the robot is, for clients: the chain map -> odom -> base -> camera of one frame. Only frames that
/// have a pose are published. Translations in metres; the stamp is on the source's clock and goes out as it
/// is.
struct StreamPose {
  Nanoseconds stamp_ns = 0;
  Pose T_map_odom{}, T_odom_base{}, T_base_camera{};
};

/// The most points that one cloud holds; a bigger map is coarsened by its owner.
constexpr std::size_t kMaxCloudPoints = 200'000;

/// What the stream has done since start.
struct StreamStats {
  std::uint64_t clients = 0;           ///< connected now
  std::uint64_t clients_peak = 0;      ///< most at once
  std::uint64_t clients_refused = 0;   ///< turned away because `stream.max_clients` were there
  std::uint64_t clients_given_up = 0;  ///< closed because they stopped reading in the middle of a cloud
  std::uint64_t messages_sent = 0;     ///< over WebSocket, to all clients together
  std::uint64_t messages_dropped = 0;  ///< poses and transforms that a slow client never got
  std::uint64_t bytes_sent = 0;        ///< payload of WebSocket messages and HTTP bodies
  std::uint64_t bad_messages = 0;      ///< from clients: malformed, unknown, too large
  std::uint64_t poses_refused = 0;     ///< published while the stream thread was far behind
};

}  // namespace stillmap
