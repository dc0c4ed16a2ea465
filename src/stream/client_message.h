// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

#include "core/fixed_vector.h"

namespace stillmap::stream {

/// What a client asked for, in one text message.
struct ClientMessage {
  enum class Kind : std::uint8_t {
    Subscribe,
    Unsubscribe,
    Unsupported,  ///< well formed, but an operation that this server doesn't have
    Malformed     ///< not JSON, not an object with "op", ids missing or not whole numbers, or more than
                  ///< kMaxItems
  };
  static constexpr std::size_t kMaxItems = 32;
  struct Subscription {
    std::uint32_t id = 0, channel_id = 0;
  };

  Kind kind = Kind::Malformed;
  FixedVector<Subscription, kMaxItems> subscriptions;  ///< of Subscribe
  FixedVector<std::uint32_t, kMaxItems> unsubscribed;  ///< of Unsubscribe: subscription ids
};

/// Reads `{"op":"subscribe","subscriptions":[{"id":1,"channelId":2}]}` and
/// `{"op":"unsubscribe","subscriptionIds":[1]}` in any order of keys; other keys are checked for being JSON
/// and passed over. Keys and operations are compared as they are written, without resolving escapes. Any
/// bytes are safe input; any thread; no heap.
ClientMessage parse_client_message(std::string_view json);

}  // namespace stillmap::stream
