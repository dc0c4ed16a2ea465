// SPDX-License-Identifier: Apache-2.0
#include "drivers/paired/paired.h"

#include <cstring>
#include <utility>

namespace stillmap {

namespace {

std::string size_text(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

GrabResult without_picture(PeekStatus status) {
  if (status == PeekStatus::EndOfStream) return {GrabStatus::EndOfStream};
  return {status == PeekStatus::Lost ? GrabStatus::Lost : GrabStatus::Timeout};
}

void copy(ImageView<const std::uint16_t> from, ImageView<std::uint16_t> to) {
  for (int y = 0; y < to.height; ++y)
    std::memcpy(to.row(y), from.row(y), static_cast<std::size_t>(to.width) * sizeof(std::uint16_t));
}

}  // namespace

Paired::Paired(Setup setup, std::unique_ptr<PictureStream> colour, std::unique_ptr<PictureStream> depth)
    : setup_(std::move(setup)), colour_(std::move(colour)), depth_(std::move(depth)) {}

Status Paired::open() {
  if (Status s = colour_->open(); !s.ok()) return s;
  if (Status s = depth_->open(); !s.ok()) return s;
  const StreamInfo colour = colour_->describe(), depth = depth_->describe();
  if (colour.width != setup_.colour.width || colour.height != setup_.colour.height) {
    return Error{ExitCode::WrongConfig, colour.name + ": delivers " + size_text(colour.width, colour.height) +
                                            " px, camera.width and camera.height say " +
                                            size_text(setup_.colour.width, setup_.colour.height) +
                                            "; take another camera profile"};
  }
  const CameraModel& lens = setup_.depth_lens ? *setup_.depth_lens : setup_.colour;
  if (depth.width != lens.width || depth.height != lens.height) {
    return Error{ExitCode::WrongConfig,
                 depth.name + ": delivers " + size_text(depth.width, depth.height) +
                     " px of depth, the profile expects " + size_text(lens.width, lens.height) +
                     "; a depth camera that does not register its pictures to colour needs its own "
                     "camera.depth.width, height, fx, fy, cx, cy and camera.depth.T_colour_depth"};
  }
  half_frame_ns_ = static_cast<Nanoseconds>(0.5e9 / describe().fps);
  converter_.emplace(colour.format, colour.width, colour.height);
  if (setup_.depth_lens) registration_.emplace(setup_.colour, *setup_.depth_lens, setup_.T_colour_depth);
  return {};
}

SourceInfo Paired::describe() const {
  const StreamInfo colour = colour_->describe();
  return {.name = setup_.name,
          .width = setup_.colour.width,
          .height = setup_.colour.height,
          .fps = colour.fps > 0 ? colour.fps : setup_.fps,
          .is_log = colour.is_log,
          .monotonic_stamps = colour.monotonic_stamps};
}

Status Paired::start() {
  STILLMAP_CHECK(converter_.has_value());
  if (Status s = depth_->start(); !s.ok()) return s;
  return colour_->start();
}

GrabResult Paired::grab(FrameSlot& slot, Nanoseconds deadline_ns) {
  for (;;) {
    HeldPicture colour, depth;
    const PeekStatus colour_status = colour_->peek(colour, deadline_ns);
    if (colour_status == PeekStatus::Corrupt) return {GrabStatus::Dropped, DropReason::CorruptColour};
    if (colour_status != PeekStatus::Picture) return without_picture(colour_status);
    if (std::exchange(colour_is_new_, false)) missed_ = colour.missed;
    if (missed_ > 0) {
      --missed_;
      return {GrabStatus::Dropped, DropReason::DriverDropped};
    }
    const PeekStatus depth_status = depth_->peek(depth, deadline_ns);
    if (depth_status == PeekStatus::Corrupt) {
      depth_trouble_ = DropReason::CorruptDepth;
      continue;
    }
    if (depth_status != PeekStatus::Picture) return without_picture(depth_status);
    if (std::exchange(depth_is_new_, false) && depth.missed > 0) depth_trouble_ = DropReason::DriverDropped;

    const Nanoseconds difference_ns = depth.stamp_ns - colour.stamp_ns;
    if (difference_ns < -half_frame_ns_) {
      depth_->release();
      depth_is_new_ = true;
      continue;
    }
    GrabResult result{GrabStatus::Dropped, depth_trouble_.value_or(DropReason::NoDepthMatch)};
    if (difference_ns <= half_frame_ns_) {
      result = fill(slot, colour, depth);
      depth_->release();
      depth_is_new_ = true;
      depth_trouble_.reset();
    }
    colour_->release();
    colour_is_new_ = true;
    return result;
  }
}

GrabResult Paired::fill(FrameSlot& slot, const HeldPicture& colour, const HeldPicture& depth) {
  const DecodeStatus converted = converter_->convert(colour.picture, slot.colour);
  if (converted == DecodeStatus::WrongSize) return {GrabStatus::Dropped, DropReason::WrongSize};
  if (converted != DecodeStatus::Ok) return {GrabStatus::Dropped, DropReason::CorruptColour};
  ImageView<const std::uint16_t> readings;
  if (depth_view(depth.picture, readings) != DecodeStatus::Ok)
    return {GrabStatus::Dropped, DropReason::CorruptDepth};
  const int width = registration_ ? registration_->width() : slot.depth.width;
  const int height = registration_ ? registration_->height() : slot.depth.height;
  if (readings.width != width || readings.height != height)
    return {GrabStatus::Dropped, DropReason::WrongSize};
  if (registration_) {
    registration_->apply(readings, slot.depth);
  } else {
    copy(readings, slot.depth);
  }
  slot.colour_ns = colour.stamp_ns;
  slot.depth_ns = depth.stamp_ns;
  return {GrabStatus::Frame};
}

void Paired::stop() {
  colour_->stop();
  depth_->stop();
}

}  // namespace stillmap
