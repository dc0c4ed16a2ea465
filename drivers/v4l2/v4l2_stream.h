// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "drivers/picture_stream.h"

namespace stillmap {

/// What a V4L2 node is asked for.
struct V4l2Request {
  std::string device;  ///< e.g. "/dev/video0"
  bool depth = false;  ///< Z16 or Y16, otherwise colour
  int width = 0, height = 0;
  double fps = 30;
  std::string format;  ///< four letters as the kernel's, e.g. "YUYV"; empty: the best that the device has
  std::vector<std::string> controls;  ///< NAME=VALUE with the names of `v4l2-ctl --list-ctrls`
};

/// One video node of the kernel: pictures stay in the driver's own buffers, mapped once, single- or
/// multi-planar. Stamps are the kernel's; where it gives none on the monotonic clock, they are taken on
/// arrival. The errors of `open` name the node and the mend.
class V4l2Stream : public PictureStream {
 public:
  explicit V4l2Stream(V4l2Request request);
  ~V4l2Stream() override;
  Status open() override;
  StreamInfo describe() const override;
  Status start() override;
  PeekStatus peek(HeldPicture& out, Nanoseconds deadline_ns) override;
  void release() override;
  void stop() override;

 private:
  class Node;
  V4l2Request request_;
  std::unique_ptr<Node> node_;  // made by open
};

/// A video node that can be captured from.
struct V4l2Device {
  std::string path, card, bus;  ///< nodes of one device share the bus
  /// How well its formats serve: 2 with colours, or with Z16; 1 with grey only, or with Y16 only; 0 not.
  int as_colour = 0, as_depth = 0;
};
/// Those of this machine that can be opened, in the order of their numbers.
std::vector<V4l2Device> list_v4l2_devices();

struct V4l2Pair {
  const V4l2Device* colour;
  const V4l2Device* depth;
};
/// Each node with depth, the best first, with the best other node to see colour by: one of the same device
/// before others', so that a depth camera's infrared does not pass for its colour. Into `devices`.
std::vector<V4l2Pair> pair_v4l2_devices(const std::vector<V4l2Device>& devices);

}  // namespace stillmap
