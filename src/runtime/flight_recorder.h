// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>
#include <string>

#include "core/event.h"
#include "core/tracking_result.h"

namespace stillmap {

/// One tracked frame, as the flight recorder keeps it.
struct FlightFrame {
  Nanoseconds at_ns = 0;  ///< monotonic
  Nanoseconds stamp_ns = 0;
  std::uint64_t sequence = 0;
  TrackState state = TrackState::Initializing;
  int matches = 0, inliers = 0;
  LabelCounts labels{};
  Pose T_map_camera{};
};

/// The last 10 s of frames and events in fixed memory, written to a file when tracking is lost or the process
/// aborts. The track thread puts frames in; everything else is the health thread's.
class FlightRecorder {
 public:
  static constexpr Nanoseconds kSpan = 10'000'000'000;
  /// Room for how many frames a camera of this rate needs.
  static std::size_t frames_for(double fps) { return static_cast<std::size_t>(fps * to_seconds(kSpan)) + 1; }

  /// An empty path: nothing is recorded.
  FlightRecorder(std::span<FlightFrame> room, std::string path) : frames_(room), path_(std::move(path)) {}

  /// Track thread. A frame that finds no room on the way is left out.
  void put(const FlightFrame& frame) {
    if (!frames_.empty()) static_cast<void>(inbox_.try_push(FlightFrame(frame)));
  }
  void put(const Event& event) { events_[event_count_++ % events_.size()] = event; }
  void take_in();
  /// Writes the file anew. Safe in a signal handler: no heap, no locks, no library but write(2). False where
  /// the file cannot be written or is no regular one.
  bool write() const;
  /// As `write`, at most once in 10 s, so that a track that comes and goes does not wear out the disk.
  bool write_unless_just_done(Nanoseconds now);
  bool enabled() const { return !frames_.empty() && !path_.empty(); }
  const std::string& path() const { return path_; }

 private:
  std::span<FlightFrame> frames_;
  std::size_t frame_count_ = 0;  // ever; the newest is at frame_count_ - 1 modulo size
  std::array<Event, 256> events_{};
  std::size_t event_count_ = 0;
  SpscRing<FlightFrame, 64> inbox_;
  std::string path_;
  Nanoseconds written_ns_ = 0;
};

/// While it lives, a signal that ends the process for a bug (SIGABRT, SIGSEGV, ...) writes the recorder's
/// file first. One at a time.
class WriteOnAbort {
 public:
  explicit WriteOnAbort(FlightRecorder& recorder);
  ~WriteOnAbort();
  WriteOnAbort(const WriteOnAbort&) = delete;
  WriteOnAbort& operator=(const WriteOnAbort&) = delete;
};

}  // namespace stillmap
