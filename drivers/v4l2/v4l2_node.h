// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <linux/videodev2.h>

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "drivers/v4l2/v4l2_formats.h"
#include "drivers/v4l2/v4l2_stream.h"

namespace stillmap {

/// ioctl, repeated when a signal interrupts it; errno says why it returns false.
bool v4l2_ioctl(int file, unsigned long request, void* argument);

/// An open video node: its file, its buffers, and the one that is looked at.
class V4l2Stream::Node {
 public:
  Node() = default;
  ~Node();
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;

  Status open(const V4l2Request& request);
  Status start(const V4l2Request& request);
  PeekStatus peek(HeldPicture& out, Nanoseconds deadline_ns);
  void release();
  void stop();
  StreamInfo info() const { return info_; }

 private:
  static constexpr std::size_t kMaxPlanes = 2, kBuffers = 4;
  struct Mapping {
    void* start = nullptr;
    std::size_t bytes = 0;
  };
  using Buffer = std::array<Mapping, kMaxPlanes>;

  Status check_capabilities(const V4l2Request& request);
  Status set_format(const V4l2Request& request, std::span<const V4l2Format> known);
  /// Whether the driver takes exactly this; what it would rather have is in `offered`.
  bool try_format(const V4l2Request& request, const V4l2Format& wanted, v4l2_format& offered);
  void set_rate(double fps);
  Status set_controls(const V4l2Request& request);
  Status map_buffers(const V4l2Request& request);
  v4l2_buffer buffer_header(std::array<v4l2_plane, kMaxPlanes>& planes, std::uint32_t index) const;
  bool queue(std::uint32_t index);
  PeekStatus dequeue();
  bool fill_picture(const v4l2_buffer& buffer, std::span<const v4l2_plane> planes);

  int file_ = -1;
  std::uint32_t type_ = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  std::size_t planes_ = 1;
  std::array<std::size_t, kMaxPlanes> strides_{};
  StreamInfo info_;
  std::vector<Buffer> buffers_;
  HeldPicture held_;
  std::optional<std::uint32_t> held_index_;
  std::optional<std::uint32_t> last_sequence_;
  bool streaming_ = false;
};

}  // namespace stillmap
