// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <ctime>
#include <string>

#include "core/status.h"
#include "core/time.h"
#include "drivers/pictures/raw_picture.h"

namespace stillmap {

/// What a stream delivers. Valid after `open`.
struct StreamInfo {
  std::string name;  ///< for people, e.g. "/dev/video0"
  PixelFormat format = PixelFormat::Bgr;
  int width = 0, height = 0;
  double fps = 0;                 ///< nominal; 0 = unknown
  bool monotonic_stamps = false;  ///< stamps are on the monotonic clock, at exposure
  bool is_log = false;            ///< recorded: it ends
};

enum class PeekStatus : std::uint8_t {
  Picture,
  Timeout,      ///< nothing arrived before the deadline
  Corrupt,      ///< the device says that this picture is damaged; it is given back already
  EndOfStream,  ///< a recording's end
  Lost          ///< the device is gone; open another
};

/// The time until a deadline as ppoll wants it; none where it has passed.
inline timespec time_until(Nanoseconds deadline_ns) {
  const Nanoseconds left_ns = std::max<Nanoseconds>(0, deadline_ns - monotonic_now());
  timespec span{};
  span.tv_sec = static_cast<time_t>(left_ns / 1'000'000'000);
  span.tv_nsec = static_cast<long>(left_ns % 1'000'000'000);
  return span;
}

/// The picture that a stream lets its user look at.
struct HeldPicture {
  RawPicture picture;
  Nanoseconds stamp_ns = 0;
  std::uint32_t missed = 0;  ///< pictures that the device or its driver lost just before this one
};

/// One half of an RGB-D camera: a stream of pictures in the device's own buffers. Its life: open (may
/// refuse), start, then for each picture peek and release, stop. Used by one thread; `peek` and `release`
/// take nothing from the heap.
class PictureStream {
 public:
  virtual ~PictureStream() = default;
  virtual Status open() = 0;
  virtual StreamInfo describe() const = 0;
  virtual Status start() = 0;
  /// Shows the oldest picture that has not been released, and waits for it until `deadline_ns` (monotonic).
  /// Its bytes stay valid until `release`; peeking again shows the same one.
  virtual PeekStatus peek(HeldPicture& out, Nanoseconds deadline_ns) = 0;
  /// Gives the held picture back to the device. Nothing happens where none is held.
  virtual void release() = 0;
  virtual void stop() = 0;
};

}  // namespace stillmap
