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

void ClientSession::reset(BlockExchange& blocks) {
  *this = ClientSession();
  blocks_ = &blocks;
  blocks.reclaim();  // what the client before had asked for
}

void ClientSession::receive(const Feed& feed, std::string_view piece, bool first, bool last, bool binary,
                            Nanoseconds now_ns) {
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
  count_message(now_ns);
  if (inbox_overrun_) {
    complain(Complaint::TooLarge);
  } else if (binary) {
    complain(Complaint::Unsupported);
  } else {
    handle(feed, parse_client_message({inbox_.data(), inbox_bytes_}));
  }
}

void ClientSession::count_message(Nanoseconds now_ns) {
  if (now_ns - second_began_ns_ >= 1'000'000'000) {
    second_began_ns_ = now_ns;
    messages_this_second_ = 0;
  }
  flooding_ = flooding_ || ++messages_this_second_ > kMaxMessagesPerSecond;
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
  const auto channel = static_cast<Channel>(wanted.channel_id);
  if (wanted.channel_id < 1 || wanted.channel_id > kChannelCount ||
      (channel == Channel::Picture && !feed.with_picture)) {
    return complain(Complaint::UnknownChannel, wanted.channel_id);
  }
  if (std::ranges::find(subscriptions_, std::optional(wanted.id)) != subscriptions_.end()) {
    return complain(Complaint::IdTaken, wanted.id);
  }
  if (subscribed(channel)) return complain(Complaint::ChannelTaken, wanted.channel_id);
  subscriptions_[index_of(channel)] = wanted.id;
  if (channel == Channel::Map) {
    cloud_generation_ = 0;
  } else if (channel == Channel::Blocks) {
    block_pass_ = {};
  } else {
    // Begins with the newest that is known; log lines with all that are.
    const Topic& topic = feed.topic(channel);
    place_[index_of(channel)] = topic.begin(channel == Channel::Log ? topic.depth() : 1);
  }
}

void ClientSession::unsubscribe(std::uint32_t id) {
  const auto found = std::ranges::find(subscriptions_, std::optional(id));
  if (found == subscriptions_.end()) return complain(Complaint::UnknownSubscription, id);
  found->reset();
  if (subscribed(Channel::Blocks)) return;
  block_pass_ = {};
  blocks_->reclaim();
}

void ClientSession::complain(Complaint complaint, std::uint32_t id) {
  ++bad_messages_;
  // Answers to a client that does not read them pile up: beyond these few it is only counted.
  static_cast<void>(notices_.try_push_back({complaint, id}));
}

bool ClientSession::owed_cloud(const CloudExchange& cloud) const {
  return subscribed(Channel::Map) && !receiving_cloud() && cloud_generation_ != cloud.generation();
}

void ClientSession::ask_for_blocks(Nanoseconds now_ns) {
  if (!subscribed(Channel::Blocks)) return;
  BlockPass& pass = block_pass_;
  const BlockAnswer& answer = blocks_->answer();
  if (blocks_pending() && blocks_->blocks().empty() && answer.complete && !pass.snapshot && !pass.begun &&
      answer.epoch == pass.epoch)
    end_block_answer();  // nothing has changed since the last pass: nothing to tell
  // Not answered: the request of the client before is still at work.
  if (pass.asked || !blocks_->answered()) return;
  if (!pass.begun) {
    if (pass.begun_ns && now_ns - *pass.begun_ns < kBlockPass_ns) return;
    pass.begun_ns = now_ns;
  }
  pass.asked = true;
  blocks_->ask(pass.next);
}

void ClientSession::end_block_answer() {
  BlockPass& pass = block_pass_;
  const BlockAnswer& answer = blocks_->answer();
  pass.asked = false;
  if (!pass.begun) pass.version = answer.version;
  pass.begun = !answer.complete;
  pass.next.cursor = pass.begun ? answer.next : 0;
  if (pass.begun) return;
  pass.next.since = pass.version;
  pass.snapshot = false;
}

bool ClientSession::pending(Channel channel, const Feed& feed) const {
  if (!subscribed(channel)) return false;
  if (channel == Channel::Map)
    return owed_cloud(feed.cloud) && feed.cloud.readable() && !feed.cloud_under_way;
  if (channel == Channel::Blocks) return blocks_pending();
  return place_[index_of(channel)] < feed.topic(channel).end();
}

std::uint64_t ClientSession::drop_outdated(const Feed& feed) {
  std::uint64_t dropped = 0;
  for (std::size_t i = 0; i < kChannelCount; ++i) {
    const Topic& topic = feed.topics[i];
    if (!subscriptions_[i] || topic.end() - place_[i] <= topic.depth() || topic.end() == 0) continue;
    const std::uint64_t newest = topic.end() - 1;
    dropped += newest - place_[i];
    place_[i] = newest;
  }
  return dropped;
}

bool ClientSession::has_pending(const Feed& feed) const {
  if (receiving_cloud() || greeted_ < feed.greetings.size() || !notices_.empty()) return true;
  for (std::uint32_t id = 1; id <= kChannelCount; ++id) {
    if (pending(static_cast<Channel>(id), feed)) return true;
  }
  return false;
}

Chunk ClientSession::next_chunk(const Feed& feed, std::span<std::uint8_t> out, Nanoseconds now_ns) {
  if (receiving_cloud()) return next_cloud_chunk(feed, out, now_ns);
  if (greeted_ < feed.greetings.size()) return write_text(feed.greetings[greeted_++], out);
  if (!notices_.empty()) return next_notice(out);
  // In turn, so that what comes often never keeps a slow client from what is large.
  for (std::size_t i = 0; i < kChannelCount; ++i) {
    const auto channel = static_cast<Channel>(1 + (turn_ + i) % kChannelCount);
    if (!pending(channel, feed)) continue;
    turn_ = static_cast<std::size_t>(channel) % kChannelCount;
    if (channel == Channel::Map) return next_cloud_chunk(feed, out, now_ns);
    if (channel == Channel::Blocks) return next_blocks(out);
    return next_item(channel, feed.topic(channel), out);
  }
  return {};
}

Chunk ClientSession::next_item(Channel channel, const Topic& topic, std::span<std::uint8_t> out) {
  std::uint64_t& place = place_[index_of(channel)];
  STILLMAP_CHECK(topic.end() - place <= topic.depth());
  const std::span<const std::uint8_t> payload = topic.payload(place);
  write_message_header(out.first<kMessageHeaderBytes>(), *subscriptions_[index_of(channel)],
                       topic.item(place).stamp_ns);
  std::ranges::copy(payload, out.begin() + kMessageHeaderBytes);
  ++place;
  return {.bytes = kMessageHeaderBytes + payload.size()};
}

Chunk ClientSession::next_blocks(std::span<std::uint8_t> out) {
  const BlockAnswer& answer = blocks_->answer();
  BlockPass& pass = block_pass_;
  if (!pass.begun) pass.epoch = answer.epoch;
  write_message_header(out.first<kMessageHeaderBytes>(), *subscriptions_[index_of(Channel::Blocks)],
                       answer.stamp_ns);
  std::size_t bytes = kMessageHeaderBytes;
  bytes += encode_blocks_envelope({.stamp_ns = answer.stamp_ns,
                                   .voxel_m = answer.voxel_m,
                                   .sequence = pass.sequence++,
                                   .snapshot = pass.snapshot,
                                   .complete = answer.complete,
                                   .epoch = pass.epoch},
                                  out.subspan<kMessageHeaderBytes, kMaxBlocksEnvelopeBytes>());
  std::ranges::copy(blocks_->blocks(), out.begin() + static_cast<std::ptrdiff_t>(bytes));
  bytes += blocks_->blocks().size();
  end_block_answer();
  return {.bytes = bytes};
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
    write_message_header(out.first<kMessageHeaderBytes>(), *subscriptions_[index_of(Channel::Map)], stamp_ns);
    chunk.bytes = kMessageHeaderBytes +
                  encode_cloud_envelope(feed.cloud.points().size(), stamp_ns, feed.cloud.epoch(),
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
  char message[160], text[256];
  const auto say = [&](const char* words) { std::snprintf(message, sizeof(message), "%s", words); };
  switch (notice.complaint) {
    case Complaint::Malformed:
      say("not a message of the Foxglove WebSocket protocol: send a JSON object with op and whole-numbered "
          "ids");
      break;
    case Complaint::TooLarge:
      say("message too large: send at most 4096 bytes");
      break;
    case Complaint::Unsupported:
      say("operation not supported: this server is read-only and takes subscribe and unsubscribe");
      break;
    case Complaint::UnknownChannel:
      std::snprintf(message, sizeof(message),
                    "there is no channel %u: subscribe to an id that was advertised", notice.id);
      break;
    case Complaint::ChannelTaken:
      std::snprintf(message, sizeof(message), "already subscribed to channel %u: unsubscribe first",
                    notice.id);
      break;
    case Complaint::IdTaken:
      std::snprintf(message, sizeof(message), "subscription id %u is in use: choose another", notice.id);
      break;
    case Complaint::UnknownSubscription:
      std::snprintf(message, sizeof(message), "there is no subscription %u", notice.id);
      break;
  }
  const int length =
      std::snprintf(text, sizeof(text), "{\"op\":\"status\",\"level\":2,\"message\":\"%s\"}", message);
  return write_text({text, static_cast<std::size_t>(length)}, out);
}

}  // namespace stillmap::stream
