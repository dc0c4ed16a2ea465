// SPDX-License-Identifier: Apache-2.0
// A camera that does everything wrong, through the whole pipeline.
#include <gtest/gtest.h>

#include <map>

#include "core/random.h"
#include "tests/runtime/running.h"

namespace stillmap {
namespace {

using test::PatientCamera;
using test::Pipeline;
using test::WallScene;
using Grab = test::ScriptedDriver::Grab;

constexpr Nanoseconds kMillisecond = 1'000'000, kHour = 3'600'000'000'000;

/// A camera's life, and what has to be counted of it.
struct Storm {
  explicit Storm(std::uint64_t seed) {
    Random random(seed);
    Nanoseconds now = WallScene::stamp_ns(0), newest = now;
    for (int i = 0; i < kGrabs; ++i) {
      Grab grab{.picture = i, .takes_ns = 2 * kMillisecond};
      now += WallScene::kFrame_ns;
      grab.stamp_ns = now;
      switch (random.below(16)) {
        case 0:  // stalls
          grab = {.status = GrabStatus::Timeout, .takes_ns = 20 * kMillisecond};
          break;
        case 1:  // delivers damage
          grab.status = GrabStatus::Dropped;
          grab.reason = kReasons[random.below(kReasons.size())];
          break;
        case 2:  // repeats itself
          grab.stamp_ns = newest;
          break;
        case 3:  // delivers late what came before
          grab.stamp_ns = newest - WallScene::kFrame_ns / 2;
          break;
        case 4:  // believes for a moment that it is an hour ago
          grab.stamp_ns -= kHour;
          break;
        case 5:  // its clock is put on by an hour
          grab.stamp_ns = now += kHour;
          break;
        case 6:  // says nonsense
          grab.stamp_ns = i % 2 == 0 ? 0 : -kHour;
          break;
        default:
          break;
      }
      if (i == 0) grab = {.stamp_ns = now, .picture = 0};
      offered += grab.status != GrabStatus::Timeout;
      if (grab.status == GrabStatus::Dropped) ++dropped[grab.reason];
      if (grab.status == GrabStatus::Frame && i > 0 && grab.stamp_ns <= newest)
        ++dropped[DropReason::TimeJump];
      if (grab.status == GrabStatus::Frame) newest = std::max(newest, grab.stamp_ns);
      grabs.push_back(grab);
    }
  }
  static constexpr int kGrabs = 150;
  static constexpr std::array kReasons{DropReason::CorruptColour, DropReason::CorruptDepth,
                                       DropReason::NoDepthMatch, DropReason::DriverDropped};
  std::vector<Grab> grabs;
  std::uint64_t offered = 0;
  std::map<DropReason, std::uint64_t> dropped;
};

TEST(SourceFaults, AStormOfThemIsCountedOneByOneAndTrackedThrough) {
  for (const RunMode mode : {RunMode::Live, RunMode::Lockstep}) {
    SCOPED_TRACE(to_string(mode));
    const Storm storm(1);
    PatientCamera camera(storm.grabs);
    Config config = WallScene::config();
    config.stream.listen = "127.0.0.1:0";
    RunOptions options;
    options.mode = mode;
    Pipeline pipeline(camera.driver, options, true, config);
    camera.pipeline = &pipeline;
    ASSERT_TRUE(pipeline.stages->stream->open().ok());
    mode == RunMode::Lockstep ? run_lockstep(*pipeline.context) : run_threads(*pipeline.context);
    pipeline.stages->stream->stop();
    EXPECT_EQ(pipeline.context->counters.offered.load(), storm.offered);
    for (const auto& [reason, count] : storm.dropped)
      EXPECT_EQ(pipeline.dropped(reason), count) << to_string(reason);
    EXPECT_EQ(pipeline.dropped(DropReason::NoFreeSlot), 0u);
    EXPECT_GT(pipeline.context->track_log.causal.size(), 20u);
    if (mode == RunMode::Lockstep) {  // live, the detector says which, when a busy machine lets it
      EXPECT_GT(pipeline.stages->map.map().fused_frames(), 10u);
    }
    EXPECT_TRUE(run_outcome(*pipeline.context).ok());
    pipeline.expect_accounted();
  }
}

}  // namespace
}  // namespace stillmap
