// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdio>
#include <cstring>

#include "core/geometry.h"
#include "core/time.h"
#include "foxglove.pb.h"

// The values that the stream's messages are made of, from ours to nanopb's structs. For the encoders' .cpp
// files alone.
namespace stillmap::stream {

inline constexpr char kMapFrame[] = "map", kCameraFrame[] = "camera";

template <std::size_t N, std::size_t M>
void set_text(char (&field)[N], const char (&text)[M]) {
  static_assert(M <= N);
  std::memcpy(field, text, M);
}

/// printf into a field; what does not fit is cut off.
template <std::size_t N, class... Args>
void format_text(char (&field)[N], const char* format, Args... args) {
  std::snprintf(field, N, format, args...);
}

inline google_protobuf_Timestamp timestamp(Nanoseconds t) {
  constexpr Nanoseconds kSecond = 1'000'000'000;
  const Nanoseconds seconds = t / kSecond, rest = t % kSecond;
  // A Timestamp's nanos count forward from its seconds, also before the epoch.
  if (rest < 0) return {seconds - 1, static_cast<std::int32_t>(rest + kSecond)};
  return {seconds, static_cast<std::int32_t>(rest)};
}

/// For a message with a timestamp.
template <class Message>
void set_stamp(Message& message, Nanoseconds stamp_ns) {
  message.has_timestamp = true;
  message.timestamp = timestamp(stamp_ns);
}

inline foxglove_Vector3 vector3(Vec3 v) {
  return {v.x, v.y, v.z};
}

inline foxglove_Quaternion quaternion(const Mat3& R) {
  const Quaternion q = quaternion_from(R);
  return {q.x, q.y, q.z, q.w};
}

inline void set_pose(foxglove_Pose& out, const Pose& T) {
  out.has_position = out.has_orientation = true;
  out.position = vector3(T.t);
  out.orientation = quaternion(T.R);
}

}  // namespace stillmap::stream
