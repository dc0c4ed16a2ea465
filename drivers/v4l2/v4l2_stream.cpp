// SPDX-License-Identifier: Apache-2.0
#include "drivers/v4l2/v4l2_stream.h"

#include <utility>

#include "drivers/v4l2/v4l2_node.h"

namespace stillmap {

V4l2Stream::V4l2Stream(V4l2Request request) : request_(std::move(request)) {}
V4l2Stream::~V4l2Stream() = default;

Status V4l2Stream::open() {
  node_ = std::make_unique<Node>();
  Status opened = node_->open(request_);
  if (!opened.ok()) node_.reset();
  return opened;
}

StreamInfo V4l2Stream::describe() const {
  STILLMAP_CHECK(node_ != nullptr);
  return node_->info();
}

Status V4l2Stream::start() {
  STILLMAP_CHECK(node_ != nullptr);
  return node_->start(request_);
}

PeekStatus V4l2Stream::peek(HeldPicture& out, Nanoseconds deadline_ns) {
  STILLMAP_CHECK(node_ != nullptr);
  return node_->peek(out, deadline_ns);
}

void V4l2Stream::release() {
  node_->release();
}

void V4l2Stream::stop() {
  if (node_ != nullptr) node_->stop();
}

}  // namespace stillmap
