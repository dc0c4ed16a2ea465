// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "stream/stream_types.h"

// What is published to the bytes of the Foxglove WebSocket protocol and its protobuf schemas
// (proto/). What is seen on a frame is
// in scene_encoding.h. Pure functions; any thread; no heap.
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
std::size_t encode_cloud_envelope(std::size_t points, Nanoseconds stamp_ns, std::uint32_t epoch,
                                  std::span<std::uint8_t, kMaxCloudEnvelopeBytes> out);

constexpr std::size_t kMaxBlocksEnvelopeBytes = 64, kMaxHealthMessageBytes = 256, kMaxLogBytes = 256;

/// One block of stillmap.MapBlocks, complete with its tag. Returns the bytes written, 0 when it does not fit.
std::size_t encode_block(const StreamBlock& block, std::span<std::uint8_t> out);

struct BlocksEnvelope {
  Nanoseconds stamp_ns = 0;
  double voxel_m = 0;
  std::uint64_t sequence = 0;
  bool snapshot = false, complete = false;
  std::uint32_t epoch = 0;
};
/// stillmap.MapBlocks up to its blocks, which complete the message. Returns the bytes written.
std::size_t encode_blocks_envelope(const BlocksEnvelope& envelope,
                                   std::span<std::uint8_t, kMaxBlocksEnvelopeBytes> out);

/// stillmap.Health. Returns the bytes written.
std::size_t encode_health(const StreamHealth& health, const StreamStats& stats, Nanoseconds stamp_ns,
                          std::span<std::uint8_t, kMaxHealthMessageBytes> out);
/// foxglove.Log; a text that is too long is cut off. Returns the bytes written.
std::size_t encode_log(LogLevel level, const char* name, const char* text, Nanoseconds stamp_ns,
                       std::span<std::uint8_t, kMaxLogBytes> out);

}  // namespace stillmap::stream
