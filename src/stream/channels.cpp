// SPDX-License-Identifier: Apache-2.0
#include "stream/channels.h"

#include <span>
#include <string_view>

#include "stream/foxglove_descriptors.h"
#include "stream/stillmap_descriptors.h"

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

std::string advertise_text(Channel channel, const char* topic, const char* schema_name,
                           const std::string& schema) {
  return R"({"op":"advertise","channels":[{"id":)" + std::to_string(static_cast<std::uint32_t>(channel)) +
         R"(,"topic":")" + topic + R"(","encoding":"protobuf","schemaName":")" + schema_name +
         R"(","schema":")" + schema + R"(","schemaEncoding":"protobuf"}]})";
}

}  // namespace

std::vector<std::string> greeting_texts(std::uint64_t session_id, bool with_picture) {
  const std::string foxglove = base64(kFoxgloveDescriptors), ours = base64(kStillmapDescriptors);
  std::vector<std::string> texts{
      R"({"op":"serverInfo","name":"stillmap","capabilities":[],"supportedEncodings":[],"metadata":{},"sessionId":")" +
      std::to_string(session_id) + R"("})"};
  const auto add = [&](Channel channel, const char* topic, const char* schema_name) {
    const bool is_ours = std::string_view(schema_name).starts_with("stillmap.");
    texts.push_back(advertise_text(channel, topic, schema_name, is_ours ? ours : foxglove));
  };
  add(Channel::Transforms, "/tf", "foxglove.FrameTransforms");
  add(Channel::Pose, "/pose", "foxglove.PoseInFrame");
  add(Channel::Map, "/map", "foxglove.PointCloud");
  add(Channel::Blocks, "/map/blocks", "stillmap.MapBlocks");
  add(Channel::Objects, "/objects", "foxglove.SceneUpdate");
  if (with_picture) add(Channel::Picture, "/camera/color", "foxglove.CompressedImage");
  add(Channel::Annotations, "/camera/annotations", "foxglove.ImageAnnotations");
  add(Channel::Calibration, "/camera/calibration", "foxglove.CameraCalibration");
  add(Channel::Health, "/health", "stillmap.Health");
  add(Channel::Log, "/log", "foxglove.Log");
  return texts;
}

}  // namespace stillmap::stream
