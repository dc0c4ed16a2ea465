// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "stream/stream_types.h"

// Poses and clouds to the bytes of the Foxglove WebSocket protocol and its protobuf schemas
// (proto/foxglove.proto). Pure functions; any thread; no heap.
namespace stillmap::stream {

/// Every message starts with u8 opcode 1, u32 subscription id, u64 stamp in ns, little endian.
constexpr std::size_t kMessageHeaderBytes = 13;
void write_message_header(std::span<std::uint8_t, kMessageHeaderBytes> out, std::uint32_t subscription_id,
                          Nanoseconds stamp_ns);

constexpr std::size_t kMaxTransformsBytes = 384, kMaxPoseBytes = 128, kMaxCloudEnvelopeBytes = 256;

/// foxglove.FrameTransforms: map -> odom, odom -> base, base -> camera. Returns the bytes written.
std::size_t encode_transforms(const StreamPose& pose, std::span<std::uint8_t, kMaxTransformsBytes> out);
/// foxglove.PoseInFrame: the camera in the map frame. Returns the bytes written.
std::size_t encode_pose(const StreamPose& pose, std::span<std::uint8_t, kMaxPoseBytes> out);
/// foxglove.PointCloud up to its data: `points` CloudPoints, as they lie in memory, complete the message.
/// Returns the bytes written.
std::size_t encode_cloud_envelope(std::size_t points, Nanoseconds stamp_ns,
                                  std::span<std::uint8_t, kMaxCloudEnvelopeBytes> out);

}  // namespace stillmap::stream
