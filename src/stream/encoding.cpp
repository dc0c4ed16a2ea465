// SPDX-License-Identifier: Apache-2.0
#include "stream/encoding.h"

#include <pb_encode.h>

#include <bit>
#include <cstring>

#include "core/check.h"
#include "foxglove.pb.h"

namespace stillmap::stream {
namespace {

static_assert(std::endian::native == std::endian::little, "points go out as they lie in memory");

constexpr std::uint32_t kCloudDataField = 6;  // PointCloud.data, which nanopb is told to leave to us
constexpr char kMapFrame[] = "map", kOdomFrame[] = "odom", kBaseFrame[] = "base", kCameraFrame[] = "camera";

template <std::size_t N, std::size_t M>
void set_text(char (&field)[N], const char (&text)[M]) {
  static_assert(M <= N);
  std::memcpy(field, text, M);
}

google_protobuf_Timestamp timestamp(Nanoseconds t) {
  constexpr Nanoseconds kSecond = 1'000'000'000;
  const Nanoseconds seconds = t / kSecond, rest = t % kSecond;
  // A Timestamp's nanos count forward from its seconds, also before the epoch.
  if (rest < 0) return {seconds - 1, static_cast<std::int32_t>(rest + kSecond)};
  return {seconds, static_cast<std::int32_t>(rest)};
}

foxglove_Vector3 vector3(Vec3 v) {
  return {v.x, v.y, v.z};
}

foxglove_Quaternion quaternion(const Mat3& R) {
  const Quaternion q = quaternion_from(R);
  return {q.x, q.y, q.z, q.w};
}

void set_pose(foxglove_Pose& out, const Pose& T) {
  out.has_position = out.has_orientation = true;
  out.position = vector3(T.t);
  out.orientation = quaternion(T.R);
}

template <std::size_t N, std::size_t M>
void add_transform(foxglove_FrameTransforms& out, Nanoseconds stamp_ns, const char (&parent)[N],
                   const char (&child)[M], const Pose& T_parent_child) {
  foxglove_FrameTransform& transform = out.transforms[out.transforms_count++];
  transform.has_timestamp = transform.has_translation = transform.has_rotation = true;
  transform.timestamp = timestamp(stamp_ns);
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
  add_transform(message, pose.stamp_ns, kMapFrame, kOdomFrame, pose.T_map_odom);
  add_transform(message, pose.stamp_ns, kOdomFrame, kBaseFrame, pose.T_odom_base);
  add_transform(message, pose.stamp_ns, kBaseFrame, kCameraFrame, pose.T_base_camera);
  pb_ostream_t stream = stream_into(out);
  STILLMAP_CHECK(pb_encode(&stream, foxglove_FrameTransforms_fields, &message));
  return stream.bytes_written;
}

std::size_t encode_pose(const StreamPose& pose, std::span<std::uint8_t, kMaxPoseBytes> out) {
  foxglove_PoseInFrame message = foxglove_PoseInFrame_init_zero;
  message.has_timestamp = message.has_pose = true;
  message.timestamp = timestamp(pose.stamp_ns);
  set_text(message.frame_id, kMapFrame);
  set_pose(message.pose, pose.T_map_odom * pose.T_odom_base * pose.T_base_camera);
  pb_ostream_t stream = stream_into(out);
  STILLMAP_CHECK(pb_encode(&stream, foxglove_PoseInFrame_fields, &message));
  return stream.bytes_written;
}

std::size_t encode_cloud_envelope(std::size_t points, Nanoseconds stamp_ns,
                                  std::span<std::uint8_t, kMaxCloudEnvelopeBytes> out) {
  foxglove_PointCloud message = foxglove_PointCloud_init_zero;
  message.has_timestamp = message.has_pose = true;
  message.timestamp = timestamp(stamp_ns);
  set_text(message.frame_id, kMapFrame);
  set_pose(message.pose, Pose{});
  message.point_stride = sizeof(CloudPoint);
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

}  // namespace stillmap::stream
