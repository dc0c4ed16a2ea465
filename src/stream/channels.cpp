// SPDX-License-Identifier: Apache-2.0
#include "stream/channels.h"

#include <span>

#include "stream/foxglove_descriptors.h"

namespace stillmap::stream {
namespace {

std::string base64(std::span<const unsigned char> bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    for (std::size_t j = 0; j < 3; ++j) group = group << 8 | (i + j < bytes.size() ? bytes[i + j] : 0U);
    for (std::size_t j = 0; j < 4; ++j) {
      text += i + j <= bytes.size() ? kDigits[group >> (18 - 6 * j) & 63] : '=';
    }
  }
  return text;
}

std::string channel_json(Channel channel, const char* topic, const char* schema_name,
                         const std::string& schema) {
  return "{\"id\":" + std::to_string(static_cast<std::uint32_t>(channel)) + ",\"topic\":\"" + topic +
         "\",\"encoding\":\"protobuf\",\"schemaName\":\"" + schema_name + "\",\"schema\":\"" + schema +
         "\",\"schemaEncoding\":\"protobuf\"}";
}

}  // namespace

std::string server_info_json(std::uint64_t session_id) {
  return "{\"op\":\"serverInfo\",\"name\":\"stillmap\",\"capabilities\":[],\"supportedEncodings\":[],"
         "\"metadata\":{},"
         "\"sessionId\":\"" +
         std::to_string(session_id) + "\"}";
}

std::string advertise_json() {
  const std::string schema = base64(kFoxgloveDescriptors);
  return "{\"op\":\"advertise\",\"channels\":[" +
         channel_json(Channel::Transforms, "/tf", "foxglove.FrameTransforms", schema) + "," +
         channel_json(Channel::Pose, "/pose", "foxglove.PoseInFrame", schema) + "," +
         channel_json(Channel::Map, "/map", "foxglove.PointCloud", schema) + "]}";
}

}  // namespace stillmap::stream
