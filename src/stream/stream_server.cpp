// SPDX-License-Identifier: Apache-2.0
#include "stream/stream_server.h"

#include <chrono>

#include "stream/publisher.h"
#include "stream/web_server.h"

namespace stillmap {
namespace {

/// Tells one start of the server from the next.
std::uint64_t session_id() {
  return static_cast<std::uint64_t>(std::chrono::system_clock::now().time_since_epoch().count());
}

}  // namespace

struct StreamServer::Impl {
  Impl(const Config& config, Arena& arena)
      : feed(stream::greeting_texts(session_id(), config.stream.preview != "off"),
             config.stream.preview != "off", arena.take<CloudPoint>("stream.cloud", kMaxCloudPoints)),
        publisher(arena, config, feed, counters),
        content(arena),
        web(config.stream, arena, feed, content, counters, events) {}

  stream::Counters counters;
  stream::Feed feed;
  stream::Publisher publisher;
  stream::HttpContent content;
  EventRing events;
  stream::WebServer web;
};

StreamServer::StreamServer(const Config& config, Arena& arena)
    : impl_(std::make_unique<Impl>(config, arena)) {}

StreamServer::~StreamServer() = default;

Status StreamServer::open() {
  return impl_->web.open();
}

int StreamServer::port() const {
  return impl_->web.port();
}

void StreamServer::publish_pose(const StreamPose& pose) {
  impl_->publisher.pose(pose);
  impl_->web.wake();
}

bool StreamServer::scene_wanted() const {
  return impl_->publisher.scene_wanted();
}

void StreamServer::publish_scene(const StreamScene& scene) {
  impl_->publisher.scene(scene);
  impl_->web.wake();
}

bool StreamServer::picture_wanted() const {
  return impl_->publisher.picture_wanted();
}

void StreamServer::publish_picture(const FrameSlot& frame, const Detections& own) {
  impl_->publisher.picture(frame, own);
  impl_->web.wake();
}

bool StreamServer::cloud_wanted() const {
  return impl_->feed.cloud.wanted();
}

std::span<CloudPoint> StreamServer::begin_cloud() {
  return impl_->feed.cloud.begin();
}

void StreamServer::publish_cloud(std::size_t points, Nanoseconds stamp_ns, std::uint32_t epoch) {
  impl_->feed.cloud.publish(points, stamp_ns, epoch);
  impl_->web.wake();
}

std::span<stream::BlockExchange> StreamServer::block_exchanges() {
  return impl_->web.block_exchanges();
}

void StreamServer::blocks_answered() {
  impl_->web.wake();
}

bool StreamServer::publish_health(const StreamHealth& health, std::string_view json,
                                  std::string_view metrics) {
  impl_->publisher.health(health);
  return impl_->content.publish(json, metrics);
}

void StreamServer::publish_log(LogLevel level, const char* name, std::string_view text) {
  impl_->publisher.log(level, name, text);
}

void StreamServer::service(int timeout_ms) {
  impl_->publisher.round(monotonic_now(),
                         [this](stream::Channel channel) { return impl_->web.subscribed(channel); });
  impl_->web.service(timeout_ms);
}

void StreamServer::stop() {
  impl_->web.stop();
}

StreamStats StreamServer::stats() const {
  StreamStats stats = impl_->counters.snapshot();
  stats.poses_refused = impl_->publisher.poses_refused();
  return stats;
}

EventRing& StreamServer::events() {
  return impl_->events;
}

}  // namespace stillmap
