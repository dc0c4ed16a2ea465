// SPDX-License-Identifier: Apache-2.0
#include "stream/stream_server.h"

#include <chrono>

#include "core/spsc_ring.h"
#include "stream/web_server.h"

namespace stillmap {
namespace {

/// Tells one start of the server from the next.
std::uint64_t session_id() {
  return static_cast<std::uint64_t>(std::chrono::system_clock::now().time_since_epoch().count());
}

}  // namespace

struct StreamServer::Impl {
  Impl(const Config::Stream& stream, Arena& arena)
      : config(stream),
        history(arena.take<stream::PoseHistory>("stream.poses", 1)),
        cloud(arena.take<CloudPoint>("stream.cloud", kMaxCloudPoints)),
        feed{stream::server_info_json(session_id()), stream::advertise_json(), history, cloud},
        content(arena),
        web(static_cast<std::size_t>(stream.max_clients), arena, feed, content, counters, events) {}

  const Config::Stream config;
  SpscRing<StreamPose, 64> poses_in;
  std::span<stream::PoseHistory> history;
  stream::CloudExchange cloud;
  stream::Feed feed;
  stream::HttpContent content;
  stream::Counters counters;
  EventRing events;
  stream::WebServer web;
};

StreamServer::StreamServer(const Config::Stream& config, Arena& arena)
    : impl_(std::make_unique<Impl>(config, arena)) {}

StreamServer::~StreamServer() = default;

Status StreamServer::open() {
  return impl_->web.open(impl_->config.listen);
}

int StreamServer::port() const {
  return impl_->web.port();
}

void StreamServer::publish_pose(const StreamPose& pose) {
  static_cast<void>(impl_->poses_in.try_push(StreamPose(pose)));  // the ring counts what it refuses
  impl_->web.wake();
}

bool StreamServer::cloud_wanted() const {
  return impl_->cloud.wanted();
}

std::span<CloudPoint> StreamServer::begin_cloud() {
  return impl_->cloud.begin();
}

void StreamServer::publish_cloud(std::size_t points, Nanoseconds stamp_ns) {
  impl_->cloud.publish(points, stamp_ns);
  impl_->web.wake();
}

bool StreamServer::publish_health(std::string_view json, std::string_view metrics) {
  return impl_->content.publish(json, metrics);
}

void StreamServer::service(int timeout_ms) {
  while (const auto pose = impl_->poses_in.try_pop()) impl_->history[0].push(*pose);
  impl_->web.service(timeout_ms);
}

void StreamServer::stop() {
  impl_->web.stop();
}

StreamStats StreamServer::stats() const {
  StreamStats stats = impl_->counters.snapshot();
  stats.poses_refused = impl_->poses_in.usage("stream.poses").refused;
  return stats;
}

EventRing& StreamServer::events() {
  return impl_->events;
}

}  // namespace stillmap
