// SPDX-License-Identifier: Apache-2.0
#include "stream/encoding.h"

#include <pb_encode.h>

#include <algorithm>
#include <bit>
#include <cstring>

#include "core/check.h"
#include "stillmap.pb.h"
#include "stream/proto_values.h"

namespace stillmap::stream {
namespace {

static_assert(std::endian::native == std::endian::little, "points go out as they lie in memory");

constexpr std::uint32_t kCloudDataField = 6;  // PointCloud.data, which nanopb is told to leave to us
constexpr std::uint32_t kBlocksField = 7;     // MapBlocks.blocks, likewise
constexpr char kOdomFrame[] = "odom", kBaseFrame[] = "base";

template <std::size_t N, std::size_t M>
void add_transform(foxglove_FrameTransforms& out, Nanoseconds stamp_ns, const char (&parent)[N],
                   const char (&child)[M], const Pose& T_parent_child) {
  foxglove_FrameTransform& transform = out.transforms[out.transforms_count++];
  set_stamp(transform, stamp_ns);
  transform.has_translation = transform.has_rotation = true;
  set_text(transform.parent_frame_id, parent);
  set_text(transform.child_frame_id, child);
  transform.translation = vector3(T_parent_child.t);
  transform.rotation = quaternion(T_parent_child.R);
}

template <std::size_t N>
void add_field(foxglove_PointCloud& cloud, const char (&name)[N], std::size_t offset,
               foxglove_PackedElementField_NumericType type) {
  foxglove_PackedElementField& field = cloud.fields[cloud.fields_count++];
  set_text(field.name, name);
  field.offset = static_cast<std::uint32_t>(offset);
  field.type = type;
}

/// MapBlock.colours.
bool write_colours(pb_ostream_t* stream, const pb_field_t* field, void* const* arg) {
  const auto& block = *static_cast<const StreamBlock*>(*arg);
  return block.count == 0 || (pb_encode_tag_for_field(stream, field) &&
                              pb_encode_string(stream, block.colours.data(), 3 * block.count));
}

pb_ostream_t stream_into(std::span<std::uint8_t> out) {
  return pb_ostream_from_buffer(out.data(), out.size());
}

}  // namespace

void write_message_header(std::span<std::uint8_t, kMessageHeaderBytes> out, std::uint32_t subscription_id,
                          Nanoseconds stamp_ns) {
  out[0] = 1;
  std::memcpy(&out[1], &subscription_id, sizeof(subscription_id));
  std::memcpy(&out[5], &stamp_ns, sizeof(stamp_ns));
}

std::size_t encode_transforms(const StreamPose& pose, std::span<std::uint8_t, kMaxTransformsBytes> out) {
  foxglove_FrameTransforms message = foxglove_FrameTransforms_init_zero;
  message.epoch = pose.epoch;
  add_transform(message, pose.stamp_ns, kMapFrame, kOdomFrame, pose.T_map_odom);
  add_transform(message, pose.stamp_ns, kOdomFrame, kBaseFrame, pose.T_odom_base);
  add_transform(message, pose.stamp_ns, kBaseFrame, kCameraFrame, pose.T_base_camera);
  pb_ostream_t stream = stream_into(out);
  STILLMAP_CHECK(pb_encode(&stream, foxglove_FrameTransforms_fields, &message));
  return stream.bytes_written;
}

std::size_t encode_pose(const StreamPose& pose, std::span<std::uint8_t, kMaxPoseBytes> out) {
  foxglove_PoseInFrame message = foxglove_PoseInFrame_init_zero;
  set_stamp(message, pose.stamp_ns);
  message.has_pose = true;
  message.epoch = pose.epoch;
  set_text(message.frame_id, kMapFrame);
  set_pose(message.pose, pose.T_map_odom * pose.T_odom_base * pose.T_base_camera);
  pb_ostream_t stream = stream_into(out);
  STILLMAP_CHECK(pb_encode(&stream, foxglove_PoseInFrame_fields, &message));
  return stream.bytes_written;
}

std::size_t encode_cloud_envelope(std::size_t points, Nanoseconds stamp_ns, std::uint32_t epoch,
                                  std::span<std::uint8_t, kMaxCloudEnvelopeBytes> out) {
  foxglove_PointCloud message = foxglove_PointCloud_init_zero;
  set_stamp(message, stamp_ns);
  message.has_pose = true;
  set_text(message.frame_id, kMapFrame);
  set_pose(message.pose, Pose{});
  message.point_stride = sizeof(CloudPoint);
  message.epoch = epoch;
  add_field(message, "x", offsetof(CloudPoint, x), foxglove_PackedElementField_NumericType_FLOAT32);
  add_field(message, "y", offsetof(CloudPoint, y), foxglove_PackedElementField_NumericType_FLOAT32);
  add_field(message, "z", offsetof(CloudPoint, z), foxglove_PackedElementField_NumericType_FLOAT32);
  add_field(message, "red", offsetof(CloudPoint, r), foxglove_PackedElementField_NumericType_UINT8);
  add_field(message, "green", offsetof(CloudPoint, g), foxglove_PackedElementField_NumericType_UINT8);
  add_field(message, "blue", offsetof(CloudPoint, b), foxglove_PackedElementField_NumericType_UINT8);
  add_field(message, "alpha", offsetof(CloudPoint, a), foxglove_PackedElementField_NumericType_UINT8);
  pb_ostream_t stream = stream_into(out);
  STILLMAP_CHECK(pb_encode(&stream, foxglove_PointCloud_fields, &message) &&
                 pb_encode_tag(&stream, PB_WT_STRING, kCloudDataField) &&
                 pb_encode_varint(&stream, points * sizeof(CloudPoint)));
  return stream.bytes_written;
}

std::size_t encode_block(const StreamBlock& block, std::span<std::uint8_t> out) {
  stillmap_MapBlock message = stillmap_MapBlock_init_zero;
  message.slot = block.slot;
  message.x = block.x;
  message.y = block.y;
  message.z = block.z;
  if (block.count > 0) {
    message.occupied.size = static_cast<pb_size_t>(block.occupied.size());
    std::ranges::copy(block.occupied, message.occupied.bytes);
  }
  message.colours.funcs.encode = write_colours;
  message.colours.arg = const_cast<StreamBlock*>(&block);  // only read
  pb_ostream_t stream = stream_into(out);
  const bool fits = pb_encode_tag(&stream, PB_WT_STRING, kBlocksField) &&
                    pb_encode_submessage(&stream, stillmap_MapBlock_fields, &message);
  return fits ? stream.bytes_written : 0;
}

std::size_t encode_blocks_envelope(const BlocksEnvelope& envelope,
                                   std::span<std::uint8_t, kMaxBlocksEnvelopeBytes> out) {
  stillmap_MapBlocks message = stillmap_MapBlocks_init_zero;
  set_stamp(message, envelope.stamp_ns);
  set_text(message.frame_id, kMapFrame);
  message.voxel_m = envelope.voxel_m;
  message.sequence = envelope.sequence;
  message.snapshot = envelope.snapshot;
  message.complete = envelope.complete;
  message.epoch = envelope.epoch;
  pb_ostream_t stream = stream_into(out);
  STILLMAP_CHECK(pb_encode(&stream, stillmap_MapBlocks_fields, &message));
  return stream.bytes_written;
}

std::size_t encode_health(const StreamHealth& health, const StreamStats& stats, Nanoseconds stamp_ns,
                          std::span<std::uint8_t, kMaxHealthMessageBytes> out) {
  stillmap_Health message = stillmap_Health_init_zero;
  set_stamp(message, stamp_ns);
  format_text(message.state, "%s", health.state);
  message.uptime_s = health.uptime_s;
  message.fps = health.fps;
  message.latency_ms = health.latency_ms;
  message.frames_offered = health.frames_offered;
  message.frames_processed = health.frames_processed;
  message.frames_dropped = health.frames_dropped;
  message.frames_lost = health.frames_lost;
  message.keyframes = health.keyframes;
  message.detector_runs = health.detector_runs;
  message.rss_bytes = health.rss_bytes;
  message.map_blocks = health.map_blocks;
  message.map_blocks_capacity = health.map_blocks_capacity;
  message.clients = static_cast<std::uint32_t>(stats.clients);
  message.messages_dropped = stats.messages_dropped;
  pb_ostream_t stream = stream_into(out);
  STILLMAP_CHECK(pb_encode(&stream, stillmap_Health_fields, &message));
  return stream.bytes_written;
}

std::size_t encode_log(LogLevel level, const char* name, const char* text, Nanoseconds stamp_ns,
                       std::span<std::uint8_t, kMaxLogBytes> out) {
  foxglove_Log message = foxglove_Log_init_zero;
  set_stamp(message, stamp_ns);
  message.level = static_cast<foxglove_Log_Level>(level);
  format_text(message.name, "%s", name);
  format_text(message.message, "%s", text);
  pb_ostream_t stream = stream_into(out);
  STILLMAP_CHECK(pb_encode(&stream, foxglove_Log_fields, &message));
  return stream.bytes_written;
}

}  // namespace stillmap::stream
