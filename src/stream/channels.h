// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace stillmap::stream {

/// What a client can subscribe to. The id on the wire is the value.
enum class Channel : std::uint32_t { Transforms = 1, Pose = 2, Map = 3 };
constexpr std::uint32_t kChannelCount = 3;

/// The two texts that greet each client: who this is, and the channels with their schemas (the whole
/// FileDescriptorSet of proto/foxglove.proto, base64). Made at start; `session_id` tells one start of the
/// server from the next.
std::string server_info_json(std::uint64_t session_id);
std::string advertise_json();

}  // namespace stillmap::stream
