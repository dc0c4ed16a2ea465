// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace stillmap::stream {

/// What a client can subscribe to. The id on the wire is the value.
enum class Channel : std::uint32_t {
  Transforms = 1,
  Pose,
  Map,
  Blocks,
  Objects,
  Picture,
  Annotations,
  Calibration,
  Health,
  Log
};
constexpr std::uint32_t kChannelCount = 10;
constexpr std::size_t index_of(Channel channel) {
  return static_cast<std::size_t>(channel) - 1;
}

/// The texts that greet each client: who this is, then each channel with its schema (the whole
/// FileDescriptorSet of its .proto file, base64) in a message of its own. Made at start; `session_id` tells
/// one start of the server from the next.
std::vector<std::string> greeting_texts(std::uint64_t session_id, bool with_picture);

}  // namespace stillmap::stream
