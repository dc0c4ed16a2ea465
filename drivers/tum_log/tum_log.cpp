// SPDX-License-Identifier: Apache-2.0
#include "drivers/tum_log/tum_log.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

#include "drivers/pictures/picture_size.h"
#include "drivers/pictures/png.h"
#include "drivers/tum_log/frame_list.h"

namespace stillmap {

namespace {

constexpr Nanoseconds kLatestStamp_ns = 4'000'000'000'000'000'000;  // as parse_stamp reads them

/// Size of a regular file in bytes, or -1.
off_t file_bytes(const std::string& path) {
  struct stat info {};
  return stat(path.c_str(), &info) == 0 && S_ISREG(info.st_mode) ? info.st_size : -1;
}

}  // namespace

/// What `grab` works with, all of it made at open.
struct TumLog::Reader {
  Reader(std::vector<ListedFrame> listed, std::size_t buffer_bytes, int width, int height)
      : frames(std::move(listed)), buffer(buffer_bytes), jpeg(width, height) {}

  /// The whole file, in the buffer. Empty for an empty file, one that cannot be read, and one larger than any
  /// file that open would make room for.
  std::span<const std::byte> contents(int file) {
    std::size_t filled = 0;
    while (filled < buffer.size()) {
      const ssize_t got = ::read(file, buffer.data() + filled, buffer.size() - filled);
      if (got < 0) return {};
      if (got == 0) return {buffer.data(), filled};
      filled += static_cast<std::size_t>(got);
    }
    return {};
  }

  /// Reads a listed file and gives it to `decode`; the reason where that fails.
  template <class Decode>
  std::optional<DropReason> load(const std::string& path, DropReason corrupt, Decode decode) {
    if (file_bytes(path) < 0) return DropReason::MissingFile;
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (file < 0) return DropReason::MissingFile;
    const DecodeStatus status = decode(contents(file));
    ::close(file);
    if (status == DecodeStatus::Ok) return std::nullopt;
    return status == DecodeStatus::WrongSize ? DropReason::WrongSize : corrupt;
  }

  /// None where the file cannot be read or is no picture.
  std::optional<PictureSize> size_of(const std::string& path) {
    std::optional<PictureSize> size;
    static_cast<void>(load(path, DropReason::MissingFile, [&](std::span<const std::byte> file) {
      size = picture_size(file);
      return DecodeStatus::Ok;
    }));
    return size;
  }

  /// The stamps of the frame at `index` in pass `pass` over the log; odd passes go backwards.
  void stamp(const ListedFrame& frame, std::size_t pass, FrameSlot& slot) const {
    const Nanoseconds shift = static_cast<Nanoseconds>(pass) * (last_ns - first_ns + interval_ns);
    const bool backwards = pass % 2 == 1;
    slot.colour_ns = (backwards ? first_ns + last_ns - frame.colour_ns : frame.colour_ns) + shift;
    slot.depth_ns = (backwards ? first_ns + last_ns - frame.depth_ns : frame.depth_ns) + shift;
  }

  std::vector<ListedFrame> frames;
  Nanoseconds first_ns = 0, last_ns = 0;  // colour stamps of the first and the last usable frame
  Nanoseconds interval_ns = 0;
  std::vector<std::byte> buffer;
  PngDecoder png;
  JpegDecoder jpeg;
};

TumLog::TumLog(std::string folder, int width, int height, int loops)
    : folder_(std::move(folder)), width_(width), height_(height), loops_(loops) {}
TumLog::~TumLog() = default;

Status TumLog::open() {
  Result<std::vector<ListedFrame>> listed = read_frame_list(folder_);
  if (!listed.ok()) return listed.error();
  // No picture of this size is larger, even uncompressed with alpha: an absurd file is dropped, not made room
  // for.
  const off_t largest_sane = static_cast<off_t>(width_) * height_ * 8 + (1 << 20);
  off_t largest = 0;
  bool any_usable = false;
  colour_stamps_.clear();
  for (const ListedFrame& frame : listed.value()) {
    colour_stamps_.push_back(frame.colour_ns);
    if (frame.known_unusable) continue;
    const off_t colour = file_bytes(frame.colour_path), depth = file_bytes(frame.depth_path);
    any_usable |= colour > 0 && depth > 0;
    for (const off_t size : {colour, depth}) {
      if (size <= largest_sane) largest = std::max(largest, size);
    }
  }
  if (!any_usable) {
    return Error{
        ExitCode::UnreadableInput,
        folder_ + ": no usable pair among " + std::to_string(listed.value().size()) +
            " listed pictures; check that the lists name files of this folder and that colour and depth "
            "stamps lie within 20 ms"};
  }
  // One byte more than the largest file: a read that fills it all has met a file that grew.
  reader_ = std::make_unique<Reader>(std::move(listed.value()), static_cast<std::size_t>(largest) + 1, width_,
                                     height_);
  const auto usable = [](const ListedFrame& frame) { return !frame.known_unusable; };
  const std::vector<ListedFrame>& frames = reader_->frames;
  reader_->first_ns = std::find_if(frames.begin(), frames.end(), usable)->colour_ns;
  reader_->last_ns = std::find_if(frames.rbegin(), frames.rend(), usable)->colour_ns;
  reader_->interval_ns = std::max<Nanoseconds>(median_interval(), 1);
  const Nanoseconds pass_ns = reader_->last_ns - reader_->first_ns + reader_->interval_ns;
  if (loops_ > 1 && pass_ns > kLatestStamp_ns / loops_)
    return Error{ExitCode::WrongConfig,
                 folder_ + ": " + std::to_string(loops_) + " passes of " +
                     std::to_string(pass_ns / 1'000'000'000) +
                     " s are more time than stamps can tell; play it fewer times (--loop)"};
  next_ = 0;
  return check_size();
}

/// By the first readable pictures.
Status TumLog::check_size() {
  const PictureSize expected{width_, height_};
  const auto text = [](PictureSize s) { return std::to_string(s.width) + "x" + std::to_string(s.height); };
  for (const ListedFrame& frame : reader_->frames) {
    if (frame.known_unusable) continue;
    const std::optional<PictureSize> colour = reader_->size_of(frame.colour_path);
    const std::optional<PictureSize> depth = reader_->size_of(frame.depth_path);
    for (const std::optional<PictureSize>& size : {colour, depth}) {
      if (size.value_or(expected) == expected) continue;
      return Error{ExitCode::WrongConfig, folder_ + ": its pictures are " + text(*size) +
                                              ", camera.width x camera.height says " + text(expected) +
                                              "; give --config with the log's own camera file"};
    }
    if (colour && depth) break;
  }
  return {};
}

Nanoseconds TumLog::median_interval() const {
  std::vector<Nanoseconds> intervals;
  for (std::size_t i = 1; i < colour_stamps_.size(); ++i) {
    intervals.push_back(colour_stamps_[i] - colour_stamps_[i - 1]);
  }
  if (intervals.empty()) return 0;
  const auto median = intervals.begin() + std::ssize(intervals) / 2;
  std::nth_element(intervals.begin(), median, intervals.end());
  return *median;
}

SourceInfo TumLog::describe() const {
  SourceInfo info{.name = "tum:" + folder_, .width = width_, .height = height_, .is_log = true};
  if (const Nanoseconds interval = median_interval(); interval > 0)
    info.fps = 1e9 / static_cast<double>(interval);
  return info;
}

Status TumLog::start() {
  STILLMAP_CHECK(reader_ != nullptr);
  next_ = 0;
  return {};
}

GrabResult TumLog::grab(FrameSlot& slot, Nanoseconds /*deadline_ns*/) {
  STILLMAP_CHECK(reader_ != nullptr);
  const std::size_t count = reader_->frames.size(), pass = next_ / count;
  if (pass == static_cast<std::size_t>(loops_)) return {GrabStatus::EndOfStream};
  const std::size_t step = next_++ % count;
  const ListedFrame& frame = reader_->frames[pass % 2 == 0 ? step : count - 1 - step];
  if (frame.known_unusable) return {GrabStatus::Dropped, *frame.known_unusable};
  reader_->stamp(frame, pass, slot);
  const auto colour = [&](std::span<const std::byte> file) {
    return PngDecoder::is_png(file) ? reader_->png.decode_colour(file, slot.colour)
                                    : reader_->jpeg.decode_colour(file, slot.colour);
  };
  const auto depth = [&](std::span<const std::byte> file) {
    return reader_->png.decode_depth(file, slot.depth);
  };
  std::optional<DropReason> reason = reader_->load(frame.colour_path, DropReason::CorruptColour, colour);
  if (!reason) reason = reader_->load(frame.depth_path, DropReason::CorruptDepth, depth);
  if (reason) return {GrabStatus::Dropped, *reason};
  return {GrabStatus::Frame};
}

}  // namespace stillmap
