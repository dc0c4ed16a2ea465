// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "core/fixed_vector.h"
#include "stream/channels.h"
#include "stream/client_message.h"
#include "stream/cloud_exchange.h"
#include "stream/pose_history.h"

namespace stillmap::stream {

/// What all clients are sent from. Read by sessions, written by the server between their turns.
struct Feed {
  const std::string server_info, advertise;
  std::span<PoseHistory> history;  ///< one, or none while planning
  CloudExchange& cloud;
  const PoseHistory& poses() const { return history[0]; }
};

/// One piece of a WebSocket message: a frame of its own, to be sent before the next piece is asked for.
struct Chunk {
  std::size_t bytes = 0;  ///< 0: nothing to send
  bool text = false;
  bool first = true, last = true;  ///< of its message
};

/// The protocol with one client, without any socket: takes its messages, and says what it is to be sent next.
/// All memory is in place; the feed is shared. Stream thread.
class ClientSession {
 public:
  static constexpr std::size_t kMaxMessageBytes = 4096;
  /// How long a client may take to receive one cloud. The buffer is shared: whoever takes longer keeps it
  /// from others.
  static constexpr Nanoseconds kCloudTimeout_ns = 5'000'000'000;

  /// A new client: forgets everything of the one before, and owes it the greeting.
  void reset() { *this = ClientSession(); }

  /// A piece of a message from the client. Its answer, if any, is among the next chunks.
  void receive(const Feed& feed, std::string_view piece, bool first, bool last, bool binary);

  /// To be called whenever the pose history has grown. Where the client is so far behind that its next pose
  /// is not kept any more, it goes on with the newest. Returns how many messages it will never get.
  std::uint64_t drop_outdated(const Feed& feed);
  bool has_pending(const Feed& feed) const;
  /// Writes the next piece for this client into `out`, which it owes the client from then on. The whole of an
  /// `advertise` must fit into `out`.
  Chunk next_chunk(const Feed& feed, std::span<std::uint8_t> out, Nanoseconds now_ns);

  bool subscribed(Channel channel) const { return subscription(channel).has_value(); }
  /// Whether it is subscribed to clouds and has not begun to receive the newest one.
  bool owed_cloud(const CloudExchange& cloud) const;
  bool receiving_cloud() const { return cloud_started_ns_.has_value(); }
  /// Whether it has stopped reading in the middle of a cloud.
  bool overdue(Nanoseconds now_ns) const {
    return cloud_started_ns_ && now_ns - *cloud_started_ns_ > kCloudTimeout_ns;
  }

  /// Since the last call: messages that could not be followed.
  std::uint64_t take_bad_messages() { return std::exchange(bad_messages_, 0); }

 private:
  enum class Complaint : std::uint8_t {
    Malformed,
    TooLarge,
    Unsupported,
    UnknownChannel,
    ChannelTaken,
    IdTaken,
    UnknownSubscription
  };
  struct Notice {
    Complaint complaint = Complaint::Malformed;
    std::uint32_t id = 0;
  };
  static constexpr std::uint32_t kPoseChannels =
      2;  // the channels with a place in the pose history come first
  enum class Greeting : std::uint8_t { ServerInfo, Advertise, Done };

  std::optional<std::uint32_t>& subscription(Channel c) {
    return subscriptions_[static_cast<std::uint32_t>(c) - 1];
  }
  const std::optional<std::uint32_t>& subscription(Channel c) const {
    return subscriptions_[static_cast<std::uint32_t>(c) - 1];
  }
  void handle(const Feed& feed, const ClientMessage& message);
  void subscribe(const Feed& feed, const ClientMessage::Subscription& wanted);
  void unsubscribe(std::uint32_t id);
  void complain(Complaint complaint, std::uint32_t id = 0);
  Chunk next_notice(std::span<std::uint8_t> out);
  /// The pose channel that is furthest behind, if any.
  std::optional<Channel> pending_pose_channel(const Feed& feed) const;
  Chunk next_pose_chunk(Channel channel, const Feed& feed, std::span<std::uint8_t> out);
  Chunk next_cloud_chunk(const Feed& feed, std::span<std::uint8_t> out, Nanoseconds now_ns);

  Greeting greeting_ = Greeting::ServerInfo;
  std::array<std::optional<std::uint32_t>, kChannelCount> subscriptions_{};
  FixedVector<Notice, 8> notices_;
  std::array<std::uint64_t, kPoseChannels> place_{};  ///< index into the pose history of the next one to send
  std::uint64_t cloud_generation_ = 0;                ///< of the cloud last begun
  std::optional<Nanoseconds> cloud_started_ns_;       ///< set while a cloud is being sent
  std::size_t cloud_offset_ = 0;                      ///< bytes of points that were sent of it
  std::uint64_t bad_messages_ = 0;
  std::array<char, kMaxMessageBytes> inbox_{};
  std::size_t inbox_bytes_ = 0;
  bool inbox_overrun_ = false;
};

}  // namespace stillmap::stream
