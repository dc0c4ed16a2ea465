// SPDX-License-Identifier: Apache-2.0
#include "stream/client_session.h"

#include <algorithm>
#include <cstdio>
#include <cstring>

#include "core/check.h"

namespace stillmap::stream {
namespace {

Chunk write_text(std::string_view text, std::span<std::uint8_t> out) {
  STILLMAP_CHECK(text.size() <= out.size());
  std::memcpy(out.data(), text.data(), text.size());
  return {.bytes = text.size(), .text = true};
}

}  // namespace

void ClientSession::receive(const Feed& feed, std::string_view piece, bool first, bool last, bool binary) {
  if (first) {
    inbox_bytes_ = 0;
    inbox_overrun_ = false;
  }
  inbox_overrun_ = inbox_overrun_ || piece.size() > inbox_.size() - inbox_bytes_;
  if (!inbox_overrun_) {
    std::memcpy(inbox_.data() + inbox_bytes_, piece.data(), piece.size());
    inbox_bytes_ += piece.size();
  }
  if (!last) return;
  if (inbox_overrun_) {
    complain(Complaint::TooLarge);
  } else if (binary) {
    complain(Complaint::Unsupported);
  } else {
    handle(feed, parse_client_message({inbox_.data(), inbox_bytes_}));
  }
}

void ClientSession::handle(const Feed& feed, const ClientMessage& message) {
  switch (message.kind) {
    case ClientMessage::Kind::Subscribe:
      for (const auto& wanted : message.subscriptions) subscribe(feed, wanted);
      return;
    case ClientMessage::Kind::Unsubscribe:
      for (const std::uint32_t id : message.unsubscribed) unsubscribe(id);
      return;
    case ClientMessage::Kind::Unsupported:
      return complain(Complaint::Unsupported);
    case ClientMessage::Kind::Malformed:
      return complain(Complaint::Malformed);
  }
}

void ClientSession::subscribe(const Feed& feed, const ClientMessage::Subscription& wanted) {
  if (wanted.channel_id < 1 || wanted.channel_id > kChannelCount) {
    return complain(Complaint::UnknownChannel, wanted.channel_id);
  }
  if (std::ranges::find(subscriptions_, std::optional(wanted.id)) != subscriptions_.end()) {
    return complain(Complaint::IdTaken, wanted.id);
  }
  const std::uint32_t index = wanted.channel_id - 1;
  if (subscriptions_[index]) return complain(Complaint::ChannelTaken, wanted.channel_id);
  subscriptions_[index] = wanted.id;
  if (index < kPoseChannels) {
    place_[index] =
        std::max<std::uint64_t>(feed.poses().end(), 1) - 1;  // begins with the newest that is known
  } else {
    cloud_generation_ = 0;
  }
}

void ClientSession::unsubscribe(std::uint32_t id) {
  const auto found = std::ranges::find(subscriptions_, std::optional(id));
  if (found == subscriptions_.end()) return complain(Complaint::UnknownSubscription, id);
  found->reset();
}

void ClientSession::complain(Complaint complaint, std::uint32_t id) {
  ++bad_messages_;
  // Answers to a client that does not read them pile up: beyond these few it is only counted.
  static_cast<void>(notices_.try_push_back({complaint, id}));
}

bool ClientSession::owed_cloud(const CloudExchange& cloud) const {
  return subscribed(Channel::Map) && !receiving_cloud() && cloud_generation_ != cloud.generation();
}

std::optional<Channel> ClientSession::pending_pose_channel(const Feed& feed) const {
  std::optional<Channel> pending;
  std::uint64_t furthest_behind = feed.poses().end();
  for (std::uint32_t i = 0; i < kPoseChannels; ++i) {
    if (!subscriptions_[i] || place_[i] >= furthest_behind) continue;
    furthest_behind = place_[i];
    pending = static_cast<Channel>(i + 1);
  }
  return pending;
}

std::uint64_t ClientSession::drop_outdated(const Feed& feed) {
  std::uint64_t dropped = 0;
  for (std::uint32_t i = 0; i < kPoseChannels; ++i) {
    if (!subscriptions_[i] || feed.poses().end() - place_[i] <= PoseHistory::kDepth) continue;
    const std::uint64_t newest = feed.poses().end() - 1;
    dropped += newest - place_[i];
    place_[i] = newest;
  }
  return dropped;
}

bool ClientSession::has_pending(const Feed& feed) const {
  return receiving_cloud() || greeting_ != Greeting::Done || !notices_.empty() ||
         pending_pose_channel(feed) || (owed_cloud(feed.cloud) && feed.cloud.readable());
}

Chunk ClientSession::next_chunk(const Feed& feed, std::span<std::uint8_t> out, Nanoseconds now_ns) {
  if (receiving_cloud()) return next_cloud_chunk(feed, out, now_ns);
  if (greeting_ == Greeting::ServerInfo) {
    greeting_ = Greeting::Advertise;
    return write_text(feed.server_info, out);
  }
  if (greeting_ == Greeting::Advertise) {
    greeting_ = Greeting::Done;
    return write_text(feed.advertise, out);
  }
  if (!notices_.empty()) return next_notice(out);
  // Before poses, or a client that is always behind with poses would never see the map.
  if (owed_cloud(feed.cloud) && feed.cloud.readable()) return next_cloud_chunk(feed, out, now_ns);
  if (const auto channel = pending_pose_channel(feed)) return next_pose_chunk(*channel, feed, out);
  return {};
}

Chunk ClientSession::next_pose_chunk(Channel channel, const Feed& feed, std::span<std::uint8_t> out) {
  std::uint64_t& place = place_[static_cast<std::uint32_t>(channel) - 1];
  STILLMAP_CHECK(feed.poses().end() - place <= PoseHistory::kDepth);
  const PoseHistory::Entry& entry = feed.poses().at(place);
  ++place;
  const std::span<const std::uint8_t> payload =
      channel == Channel::Transforms
          ? std::span<const std::uint8_t>(entry.transforms).first(entry.transforms_bytes)
          : std::span<const std::uint8_t>(entry.pose).first(entry.pose_bytes);
  write_message_header(out.first<kMessageHeaderBytes>(), *subscription(channel), entry.stamp_ns);
  std::ranges::copy(payload, out.begin() + kMessageHeaderBytes);
  return {.bytes = kMessageHeaderBytes + payload.size()};
}

Chunk ClientSession::next_cloud_chunk(const Feed& feed, std::span<std::uint8_t> out, Nanoseconds now_ns) {
  STILLMAP_CHECK(feed.cloud.readable());
  const std::span<const std::byte> points = std::as_bytes(feed.cloud.points());
  Chunk chunk{.first = !receiving_cloud()};
  if (chunk.first) {
    cloud_started_ns_ = now_ns;
    cloud_generation_ = feed.cloud.generation();
    cloud_offset_ = 0;
    const Nanoseconds stamp_ns = feed.cloud.stamp_ns();
    write_message_header(out.first<kMessageHeaderBytes>(), *subscription(Channel::Map), stamp_ns);
    chunk.bytes = kMessageHeaderBytes +
                  encode_cloud_envelope(feed.cloud.points().size(), stamp_ns,
                                        out.subspan<kMessageHeaderBytes, kMaxCloudEnvelopeBytes>());
  }
  const std::size_t bytes = std::min(points.size() - cloud_offset_, out.size() - chunk.bytes);
  std::memcpy(out.data() + chunk.bytes, points.data() + cloud_offset_, bytes);
  chunk.bytes += bytes;
  cloud_offset_ += bytes;
  chunk.last = cloud_offset_ == points.size();
  if (chunk.last) cloud_started_ns_.reset();
  return chunk;
}

Chunk ClientSession::next_notice(std::span<std::uint8_t> out) {
  const Notice notice = notices_[0];
  std::copy(notices_.begin() + 1, notices_.end(), notices_.begin());
  notices_.truncate(notices_.size() - 1);
  const char* format = "";
  switch (notice.complaint) {
    case Complaint::Malformed:
      format =
          "not a message of the Foxglove WebSocket protocol: send a JSON object with op and whole-numbered "
          "ids";
      break;
    case Complaint::TooLarge:
      format = "message too large: send at most 4096 bytes";
      break;
    case Complaint::Unsupported:
      format = "operation not supported: this server is read-only and takes subscribe and unsubscribe";
      break;
    case Complaint::UnknownChannel:
      format = "there is no channel %u: subscribe to an id that was advertised";
      break;
    case Complaint::ChannelTaken:
      format = "already subscribed to channel %u: unsubscribe first";
      break;
    case Complaint::IdTaken:
      format = "subscription id %u is in use: choose another";
      break;
    case Complaint::UnknownSubscription:
      format = "there is no subscription %u";
      break;
  }
  char message[160], text[256];
  std::snprintf(message, sizeof(message), format, notice.id);
  const int length =
      std::snprintf(text, sizeof(text), "{\"op\":\"status\",\"level\":2,\"message\":\"%s\"}", message);
  return write_text({text, static_cast<std::size_t>(length)}, out);
}

}  // namespace stillmap::stream
