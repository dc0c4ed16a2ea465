// SPDX-License-Identifier: Apache-2.0
#include "drivers/v4l2/v4l2_node.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstring>
#include <utility>

namespace stillmap {

bool v4l2_ioctl(int file, unsigned long request, void* argument) {
  int result = 0;
  do {
    result = ioctl(file, request, argument);
  } while (result != 0 && errno == EINTR);
  return result == 0;
}

V4l2Stream::Node::~Node() {
  stop();
  for (const Buffer& buffer : buffers_) {
    for (const Mapping& mapping : buffer) {
      if (mapping.start != nullptr) munmap(mapping.start, mapping.bytes);
    }
  }
  if (file_ >= 0) close(file_);
}

v4l2_buffer V4l2Stream::Node::buffer_header(std::array<v4l2_plane, kMaxPlanes>& planes,
                                            std::uint32_t index) const {
  v4l2_buffer buffer{};
  buffer.type = type_;
  buffer.memory = V4L2_MEMORY_MMAP;
  buffer.index = index;
  if (V4L2_TYPE_IS_MULTIPLANAR(type_)) {
    buffer.m.planes = planes.data();
    buffer.length = kMaxPlanes;
  }
  return buffer;
}

bool V4l2Stream::Node::queue(std::uint32_t index) {
  std::array<v4l2_plane, kMaxPlanes> planes{};
  v4l2_buffer buffer = buffer_header(planes, index);
  return v4l2_ioctl(file_, VIDIOC_QBUF, &buffer);
}

Status V4l2Stream::Node::start(const V4l2Request& request) {
  for (std::uint32_t i = 0; i < buffers_.size(); ++i) {
    if (!queue(i)) {
      return Error{ExitCode::RunFailed, request.device + ": the driver takes no buffer (" +
                                            std::strerror(errno) +
                                            "); unplug the camera and plug it in again"};
    }
  }
  if (!v4l2_ioctl(file_, VIDIOC_STREAMON, &type_)) {
    const std::string why = std::strerror(errno);
    return Error{ExitCode::RunFailed,
                 request.device + ": cannot stream (" + why +
                     "); is another program using the camera, or do too many share one USB bus?"};
  }
  streaming_ = true;
  last_sequence_.reset();
  return {};
}

PeekStatus V4l2Stream::Node::peek(HeldPicture& out, Nanoseconds deadline_ns) {
  while (!held_index_) {
    pollfd waiting{file_, POLLIN, 0};
    const timespec span = time_until(deadline_ns);
    const int ready = ppoll(&waiting, 1, &span, nullptr);
    if (ready == 0) return PeekStatus::Timeout;
    if (ready < 0 && errno != EINTR) return PeekStatus::Lost;
    if (ready < 0) continue;
    const PeekStatus status = dequeue();
    if (status == PeekStatus::Picture || status == PeekStatus::Timeout) continue;
    return status;
  }
  out = held_;
  return PeekStatus::Picture;
}

/// Picture: one is held now. Timeout: the wait was for nothing.
PeekStatus V4l2Stream::Node::dequeue() {
  std::array<v4l2_plane, kMaxPlanes> planes{};
  v4l2_buffer buffer = buffer_header(planes, 0);
  if (!v4l2_ioctl(file_, VIDIOC_DQBUF, &buffer))
    return errno == EAGAIN ? PeekStatus::Timeout : PeekStatus::Lost;
  // A driver without a counter leaves it at 0; then nothing can be said about gaps.
  const std::uint32_t step = last_sequence_ ? buffer.sequence - *last_sequence_ : 1;
  constexpr std::uint32_t kSaneGap = 1000;  // a counter that starts anew is no gap
  last_sequence_ = buffer.sequence;
  held_.missed += step >= 1 && step <= kSaneGap ? step - 1 : 0;
  if ((buffer.flags & V4L2_BUF_FLAG_ERROR) != 0 || !fill_picture(buffer, planes))
    return queue(buffer.index) ? PeekStatus::Corrupt : PeekStatus::Lost;
  held_index_ = buffer.index;
  const bool monotonic = (buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
  held_.stamp_ns = monotonic ? static_cast<Nanoseconds>(buffer.timestamp.tv_sec) * 1'000'000'000 +
                                   static_cast<Nanoseconds>(buffer.timestamp.tv_usec) * 1000
                             : monotonic_now();
  return PeekStatus::Picture;
}

/// False where the buffer holds less than a picture.
bool V4l2Stream::Node::fill_picture(const v4l2_buffer& buffer, std::span<const v4l2_plane> planes) {
  held_.picture = {info_.format, info_.width, info_.height, {}};
  for (std::size_t p = 0; p < planes_; ++p) {
    const Mapping& mapping = buffers_[buffer.index][p];
    const bool multi = V4L2_TYPE_IS_MULTIPLANAR(type_);
    const std::size_t used = multi ? planes[p].bytesused : buffer.bytesused;
    const std::size_t offset = multi ? planes[p].data_offset : 0;
    if (offset >= used || used > mapping.bytes) return false;
    held_.picture.planes[p] = {static_cast<const std::byte*>(mapping.start) + offset, used - offset,
                               strides_[p]};
  }
  const bool in_one_plane = planes_ == 1;
  const std::size_t least = picture_bytes(info_.format, info_.height, row_bytes(info_.format, info_.width));
  return !in_one_plane || held_.picture.planes[0].bytes >= least;
}

void V4l2Stream::Node::release() {
  if (!held_index_) return;
  // A device that takes no buffer any more is gone, which the next peek finds.
  static_cast<void>(queue(*held_index_));
  held_index_.reset();
  held_.missed = 0;
}

void V4l2Stream::Node::stop() {
  if (!std::exchange(streaming_, false)) return;
  v4l2_ioctl(file_, VIDIOC_STREAMOFF, &type_);  // gives every buffer back; a device that is gone needs none
  held_index_.reset();
  held_.missed = 0;
}

}  // namespace stillmap
