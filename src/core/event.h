// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "core/spsc_ring.h"
#include "core/time.h"

namespace stillmap {

enum class Stage : std::uint8_t { Capture, Detect, Track, Adjust, Map, Stream, Health };
constexpr int kStageCount = 7;
const char* to_string(Stage stage);

/// What happened. Add codes at the end: they are written into logs.
enum class EventCode : std::uint8_t {
  TrackingStarted,  ///< the first pose
  TrackingWeak,
  TrackingLost,
  Relocalized,
  DetectorFailed,
  ClientConnected,    ///< a = clients now
  ClientGone,         ///< a = clients now
  QualityLowered,     ///< a = step of the shedding plan now
  QualityRaised,      ///< a = step of the shedding plan now
  StageLate,          ///< at work for longer than it may; a = ms
  StageInTime,        ///< again
  SourceGone,         ///< the camera was unplugged; a = ms since its last frame
  SourceStalled,      ///< the camera fell silent and is opened anew; a = ms since its last frame
  SourceBack,         ///< the camera delivers again; a = tries that it took
  DepthEmpty,         ///< hardly a reading; a = percent of the pixels without
  DepthScale,         ///< the depth unit cannot be right; a = percent of the readings out of range
  DepthUnregistered,  ///< depth is not seen from where colour is; a = px that its edges lie off
  LoopClosed,         ///< a known place was recognised and the map mended; a = correction epoch
  SegmentStarted,     ///< lost for long, tracking begins anew at a predicted pose; a = segment
  SourceRefused,      ///< the camera cannot be opened anew, for a reason told beside; a = tries so far
  SourceTimeJump,     ///< the camera's clock was set; a = ms forwards
};
const char* to_string(EventCode code);

/// Why a frame never reached the tracker.
enum class DropReason : std::uint8_t {
  MissingFile,  ///< the list names a file that is not there
  CorruptColour,
  CorruptDepth,
  WrongSize,      ///< another size than the camera profile's
  NoDepthMatch,   ///< no depth picture within the association window
  NoFreeSlot,     ///< every pool frame was held
  TrackerBehind,  ///< the tracker skipped to a newer frame
  TimeJump,       ///< the stamp is not later than the one before
  DriverDropped,  ///< the device or its driver lost it, as its sequence numbers show
};
constexpr int kDropReasonCount = 9;
const char* to_string(DropReason reason);

/// A thing that happened on a hot stage, as plain numbers; the health thread makes the words.
struct Event {
  Nanoseconds stamp_ns = 0;  ///< monotonic
  Stage stage = Stage::Health;
  EventCode code = EventCode::TrackingStarted;
  std::uint64_t sequence = 0;
  std::int64_t a = 0;  ///< as the code says
};

/// One stage's events on their way to the health thread: the stage produces, health consumes, a full ring
/// counts.
using EventRing = SpscRing<Event, 256>;

}  // namespace stillmap
