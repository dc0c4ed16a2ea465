// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/fixed_vector.h"
#include "stream/block_exchange.h"
#include "stream/channels.h"
#include "stream/client_message.h"
#include "stream/cloud_exchange.h"
#include "stream/topic.h"

namespace stillmap::stream {

/// The largest WebSocket frame, which every message but clouds fits into with its header.
constexpr std::size_t kChunkBytes = 48 * 1024;
constexpr std::size_t kMaxPayloadBytes = kChunkBytes - kMessageHeaderBytes;

/// What all clients are sent from. Read by sessions, written by the server between their turns.
struct Feed {
  Feed(std::vector<std::string> texts, bool picture, std::span<CloudPoint> cloud_memory)
      : greetings(std::move(texts)), with_picture(picture), cloud(cloud_memory) {}
  const std::vector<std::string> greetings;
  const bool with_picture;                  ///< whether there is a channel for it
  std::array<Topic, kChannelCount> topics;  ///< by channel; Map and Blocks are no topics
  CloudExchange cloud;
  bool cloud_under_way = false;  ///< it is some client's turn: no other begins to receive it

  Topic& topic(Channel channel) { return topics[index_of(channel)]; }
  const Topic& topic(Channel channel) const { return topics[index_of(channel)]; }
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
  /// More messages than this in a second are no viewer's.
  static constexpr int kMaxMessagesPerSecond = 100;
  /// How long a client may take to receive one cloud. The buffer is shared: whoever takes longer keeps it
  /// from others.
  static constexpr Nanoseconds kCloudTimeout_ns = 5'000'000'000;
  /// A client's poses wait behind its cloud. Clouds go out one after the other, so that they wait for that
  /// one alone and not for everybody's; who takes longer than this no longer keeps the others from beginning.
  static constexpr Nanoseconds kCloudTurn_ns = 50'000'000;
  /// Passes over the map's blocks begin at most this often.
  static constexpr Nanoseconds kBlockPass_ns = 250'000'000;

  /// A new client: forgets everything of the one before, and owes it the greeting. `blocks` is its own.
  void reset(BlockExchange& blocks);

  /// A piece of a message from the client. Its answer, if any, is among the next chunks.
  void receive(const Feed& feed, std::string_view piece, bool first, bool last, bool binary,
               Nanoseconds now_ns);

  /// To be called whenever topics have grown. Where the client is so far behind that its next message is not
  /// kept any more, it goes on with the newest. Returns how many messages it will never get.
  std::uint64_t drop_outdated(const Feed& feed);
  /// To be called often: asks the map for the client's next blocks when it is time.
  void ask_for_blocks(Nanoseconds now_ns);
  bool has_pending(const Feed& feed) const;
  /// Writes the next piece for this client into `out` (at least kChunkBytes), which it owes the client from
  /// then on.
  Chunk next_chunk(const Feed& feed, std::span<std::uint8_t> out, Nanoseconds now_ns);

  bool subscribed(Channel channel) const { return subscriptions_[index_of(channel)].has_value(); }
  /// Whether it is subscribed to clouds and has not begun to receive the newest one.
  bool owed_cloud(const CloudExchange& cloud) const;
  bool receiving_cloud() const { return cloud_started_ns_.has_value(); }
  /// Whether it is still its turn to receive the cloud, which others have to wait for.
  bool has_cloud_turn(Nanoseconds now_ns) const {
    return cloud_started_ns_ && now_ns - *cloud_started_ns_ < kCloudTurn_ns;
  }
  /// Whether it has stopped reading in the middle of a cloud, or sends too much.
  bool intolerable(Nanoseconds now_ns) const {
    return flooding_ || (cloud_started_ns_ && now_ns - *cloud_started_ns_ > kCloudTimeout_ns);
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
  /// Where the client is in the map's blocks.
  struct BlockPass {
    BlockRequest next;
    std::uint64_t version = 0;   ///< of the map when this pass began
    std::uint32_t epoch = 0;     ///< likewise; once it is over, what the client was told last
    std::uint64_t sequence = 0;  ///< messages so far
    bool snapshot = true, begun = false;
    bool asked = false;  ///< the exchange's request is this client's
    std::optional<Nanoseconds> begun_ns;
  };

  void count_message(Nanoseconds now_ns);
  void handle(const Feed& feed, const ClientMessage& message);
  void subscribe(const Feed& feed, const ClientMessage::Subscription& wanted);
  void unsubscribe(std::uint32_t id);
  void complain(Complaint complaint, std::uint32_t id = 0);
  bool pending(Channel channel, const Feed& feed) const;
  bool blocks_pending() const { return block_pass_.asked && blocks_->answered(); }
  void end_block_answer();
  Chunk next_notice(std::span<std::uint8_t> out);
  Chunk next_item(Channel channel, const Topic& topic, std::span<std::uint8_t> out);
  Chunk next_cloud_chunk(const Feed& feed, std::span<std::uint8_t> out, Nanoseconds now_ns);
  Chunk next_blocks(std::span<std::uint8_t> out);

  std::size_t greeted_ = 0;  ///< greetings sent
  std::array<std::optional<std::uint32_t>, kChannelCount> subscriptions_{};
  FixedVector<Notice, 8> notices_;
  std::array<std::uint64_t, kChannelCount> place_{};  ///< in each topic, of the next message to send
  std::size_t turn_ = 0;                              ///< the channel that is served first
  std::uint64_t cloud_generation_ = 0;                ///< of the cloud last begun
  std::optional<Nanoseconds> cloud_started_ns_;       ///< set while a cloud is being sent
  std::size_t cloud_offset_ = 0;                      ///< bytes of points that were sent of it
  BlockExchange* blocks_ = nullptr;
  BlockPass block_pass_;
  std::uint64_t bad_messages_ = 0;
  Nanoseconds second_began_ns_ = 0;
  int messages_this_second_ = 0;
  bool flooding_ = false;
  std::array<char, kMaxMessageBytes> inbox_{};
  std::size_t inbox_bytes_ = 0;
  bool inbox_overrun_ = false;
};

}  // namespace stillmap::stream
