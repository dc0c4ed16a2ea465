// SPDX-License-Identifier: Apache-2.0
#include "core/event.h"

#include <array>
#include <cstddef>

namespace stillmap {

namespace {

// In the order of their enumerations.
constexpr std::array kStages{"capture", "detect", "track", "adjust", "map", "stream", "health"};
static_assert(kStages.size() == kStageCount);

constexpr std::array kEventCodes{
    "tracking_started", "tracking_weak",      "tracking_lost",   "relocalized",     "detector_failed",
    "client_connected", "client_gone",        "quality_lowered", "quality_raised",  "stage_late",
    "stage_in_time",    "source_gone",        "source_stalled",  "source_back",     "depth_empty",
    "depth_scale",      "depth_unregistered", "loop_closed",     "segment_started", "source_refused",
    "source_time_jump"};
static_assert(kEventCodes.size() == static_cast<std::size_t>(EventCode::SourceTimeJump) + 1);

constexpr std::array kDropReasons{"missing_file",   "corrupt_colour", "corrupt_depth",
                                  "wrong_size",     "no_depth_match", "no_free_slot",
                                  "tracker_behind", "time_jump",      "driver_dropped"};
static_assert(kDropReasons.size() == kDropReasonCount);

/// Also of what is no value of its enumeration: a flight recorder writes what is left after a bug.
const char* name_in(const auto& names, auto value) {
  const auto at = static_cast<std::size_t>(value);
  return at < names.size() ? names[at] : "?";
}

}  // namespace

const char* to_string(Stage stage) {
  return name_in(kStages, stage);
}
const char* to_string(EventCode code) {
  return name_in(kEventCodes, code);
}
const char* to_string(DropReason reason) {
  return name_in(kDropReasons, reason);
}

}  // namespace stillmap
