// SPDX-License-Identifier: Apache-2.0
#include "core/event.h"

#include <gtest/gtest.h>

#include <set>
#include <string>

namespace stillmap {
namespace {

/// Names go into logs and as keys into the report: each value has its own.
template <class Enum>
void expect_names(int count) {
  std::set<std::string> names;
  for (int i = 0; i < count; ++i) names.insert(to_string(static_cast<Enum>(i)));
  EXPECT_EQ(names.size(), static_cast<std::size_t>(count));
  EXPECT_FALSE(names.contains("?"));
  EXPECT_STREQ(to_string(static_cast<Enum>(count)), "?") << "a value without a count";
}

TEST(Event, EveryValueHasAName) {
  expect_names<Stage>(kStageCount);
  expect_names<DropReason>(kDropReasonCount);
  expect_names<EventCode>(static_cast<int>(EventCode::SourceTimeJump) + 1);
}

TEST(Event, ANameIsItsOwnValues) {
  EXPECT_STREQ(to_string(Stage::Adjust), "adjust");
  EXPECT_STREQ(to_string(DropReason::NoFreeSlot), "no_free_slot");
  EXPECT_STREQ(to_string(DropReason::DriverDropped), "driver_dropped");
  EXPECT_STREQ(to_string(EventCode::DetectorFailed), "detector_failed");
  EXPECT_STREQ(to_string(EventCode::StageInTime), "stage_in_time");
  EXPECT_STREQ(to_string(EventCode::SourceBack), "source_back");
  EXPECT_STREQ(to_string(EventCode::DepthUnregistered), "depth_unregistered");
  EXPECT_STREQ(to_string(EventCode::SourceTimeJump), "source_time_jump");
}

TEST(Event, AFullRingCountsWhatItRefused) {
  EventRing ring;
  for (std::uint64_t i = 0; i < 300; ++i) {
    EXPECT_EQ(ring.try_push({.stamp_ns = 1, .stage = Stage::Track, .sequence = i}), i < 256);
  }
  EXPECT_EQ(ring.usage("events").refused, 44u);
  EXPECT_EQ(ring.try_pop()->sequence, 0u);
}

}  // namespace
}  // namespace stillmap
