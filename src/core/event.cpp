// SPDX-License-Identifier: Apache-2.0
#include "core/event.h"

namespace stillmap {

const char* to_string(Stage stage) {
  switch (stage) {
    case Stage::Capture:
      return "capture";
    case Stage::Detect:
      return "detect";
    case Stage::Track:
      return "track";
    case Stage::Adjust:
      return "adjust";
    case Stage::Map:
      return "map";
    case Stage::Stream:
      return "stream";
    case Stage::Health:
      return "health";
  }
  return "?";
}

const char* to_string(EventCode code) {
  switch (code) {
    case EventCode::TrackingStarted:
      return "tracking_started";
    case EventCode::TrackingWeak:
      return "tracking_weak";
    case EventCode::TrackingLost:
      return "tracking_lost";
    case EventCode::Relocalized:
      return "relocalized";
    case EventCode::DetectorFailed:
      return "detector_failed";
    case EventCode::ClientConnected:
      return "client_connected";
    case EventCode::ClientGone:
      return "client_gone";
    case EventCode::QualityLowered:
      return "quality_lowered";
    case EventCode::QualityRaised:
      return "quality_raised";
    case EventCode::StageLate:
      return "stage_late";
    case EventCode::StageInTime:
      return "stage_in_time";
    case EventCode::SourceGone:
      return "source_gone";
    case EventCode::SourceStalled:
      return "source_stalled";
    case EventCode::SourceBack:
      return "source_back";
    case EventCode::LoopClosed:
      return "loop_closed";
    case EventCode::SegmentStarted:
      return "segment_started";
    case EventCode::SourceRefused:
      return "source_refused";
    case EventCode::SourceTimeJump:
      return "source_time_jump";
    case EventCode::DepthEmpty:
      return "depth_empty";
    case EventCode::DepthScale:
      return "depth_scale";
    case EventCode::DepthUnregistered:
      return "depth_unregistered";
  }
  return "?";
}

const char* to_string(DropReason reason) {
  switch (reason) {
    case DropReason::MissingFile:
      return "missing_file";
    case DropReason::CorruptColour:
      return "corrupt_colour";
    case DropReason::CorruptDepth:
      return "corrupt_depth";
    case DropReason::WrongSize:
      return "wrong_size";
    case DropReason::NoDepthMatch:
      return "no_depth_match";
    case DropReason::NoFreeSlot:
      return "no_free_slot";
    case DropReason::TrackerBehind:
      return "tracker_behind";
    case DropReason::TimeJump:
      return "time_jump";
    case DropReason::DriverDropped:
      return "driver_dropped";
  }
  return "?";
}

}  // namespace stillmap
