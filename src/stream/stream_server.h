// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <span>
#include <string_view>

#include "core/arena.h"
#include "core/config.h"
#include "core/event.h"
#include "core/frame_pool.h"
#include "core/status.h"
#include "stream/block_exchange.h"
#include "stream/stream_types.h"

namespace stillmap {

/// Pose, map, objects, preview and health for any number of viewers on one TCP port: the Foxglove WebSocket
/// protocol (see docs/stream.md) and HTTP `/`, `/health`, `/metrics`. Read-only: nothing a client sends
/// changes anything but its own subscriptions.
///
/// Each group of calls belongs to one thread; no call waits for another thread or for a client, except
/// `service` and `stop` as they say. In lockstep one thread makes all the calls. The object must outlive
/// every publishing thread.
class StreamServer {
 public:
  /// Takes all memory that clients will need; opens nothing. With a planning arena that is all it is good
  /// for.
  StreamServer(const Config& config, Arena& arena);
  ~StreamServer();
  StreamServer(const StreamServer&) = delete;
  StreamServer& operator=(const StreamServer&) = delete;

  /// Listens on `stream.listen`, ADDR:PORT with a numeric address; port 0 takes any free one. Once, at start.
  Status open();
  /// The port that is listened on.
  int port() const;

  /// Track thread. Every frame that has a pose, in order.
  void publish_pose(const StreamPose& pose);

  /// Track thread. True while a client wants to know what is on the frames.
  bool scene_wanted() const;
  /// Track thread. While wanted, every frame, with a pose or without.
  void publish_scene(const StreamScene& scene);

  /// One thread: the detector's; where `stream.preview` is full, the track thread, after the frame's scene.
  /// True when a preview is due: at most ten times a second, and never without a client.
  bool picture_wanted() const;
  /// The same thread; a third of a millisecond. `own`: what was detected on this very frame.
  void publish_picture(const FrameSlot& frame, const Detections& own);

  /// Map thread. True when a client waits for a newer cloud: at most once a second, and never without a
  /// client. Answer by filling `begin_cloud()` when the map has changed since the last one, and else by doing
  /// nothing.
  bool cloud_wanted() const;
  /// Map thread. Room for kMaxCloudPoints points, to be followed by `publish_cloud`; empty when no cloud is
  /// wanted any more.
  std::span<CloudPoint> begin_cloud();
  /// Map thread. Hands over the first `points` of them; `epoch` is the newest correction that all of them
  /// follow.
  void publish_cloud(std::size_t points, Nanoseconds stamp_ns, std::uint32_t epoch);

  /// Map thread. Each client's wishes for the map's blocks: answer those that `begin()`, then call
  /// `blocks_answered()` once.
  std::span<stream::BlockExchange> block_exchanges();
  void blocks_answered();

  /// Any one thread. A line for /log; what is too long is cut off.
  void publish_log(LogLevel level, const char* name, std::string_view text);
  /// The same thread. What the topic /health, and over HTTP `/health` (JSON) and `/metrics` (Prometheus text)
  /// answer from now on. False, and nothing is published, when a text is longer than 4 KB or 12 KB.
  [[nodiscard]] bool publish_health(const StreamHealth& health, std::string_view json,
                                    std::string_view metrics);

  /// Stream thread. Sends what is due and answers what came in; returns after one round, which starts at once
  /// when there is work or a pose is published, and otherwise after `timeout_ms`. 0: never waits. Bounded
  /// work: at most 256 KB per client and round.
  void service(int timeout_ms);
  /// Stream thread, at the end. Sends every client a close frame and waits at most 500 ms for their
  /// farewells.
  void stop();

  /// Any thread.
  StreamStats stats() const;
  /// ClientConnected and ClientGone (a = clients now), for one consumer.
  EventRing& events();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace stillmap
