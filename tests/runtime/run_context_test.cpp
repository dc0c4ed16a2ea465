// SPDX-License-Identifier: Apache-2.0
#include "runtime/run_context.h"

#include <gtest/gtest.h>

#include "tests/runtime/pipeline.h"
#include "tests/track/scene.h"

namespace stillmap {
namespace {

using test::Pipeline;
using test::wall_driver;
using test::WallScene;

struct TrackFrameBench {
  TrackFrameBench() : driver(wall_driver(true, {})), pipeline(driver) {}
  bool track(int index, bool blank) {
    FrameHandle frame = pipeline.stages->frames.acquire();
    FrameSlot& slot = frame.writable();
    scene.draw(index, slot);
    if (blank) std::fill_n(slot.colour.data, WallScene::kWidth * WallScene::kHeight, Bgr{});
    slot.sequence = static_cast<std::uint64_t>(index);
    slot.due_ns = monotonic_now();
    return track_frame(*pipeline.context, *frame);
  }
  std::vector<std::pair<EventCode, std::uint64_t>> events() {
    std::vector<std::pair<EventCode, std::uint64_t>> found;
    while (const auto e = pipeline.context->events_of(Stage::Track).try_pop())
      found.emplace_back(e->code, e->sequence);
    return found;
  }
  WallScene scene;
  test::ScriptedDriver driver;
  Pipeline pipeline;
};

TEST(TrackFrame, CountsAndTellsWhatBecomesOfTracking) {
  TrackFrameBench bench;
  EXPECT_FALSE(bench.track(0, true));  // nothing to start from
  for (int i = 1; i < 5; ++i) EXPECT_TRUE(bench.track(i, false)) << i;
  for (int i = 5; i < 8; ++i) EXPECT_FALSE(bench.track(i, true)) << i;
  for (int i = 8; i < 11; ++i) EXPECT_TRUE(bench.track(i, false)) << i;
  using E = EventCode;
  EXPECT_EQ(bench.events(), (std::vector<std::pair<E, std::uint64_t>>{
                                {E::TrackingStarted, 1}, {E::TrackingLost, 5}, {E::Relocalized, 8}}));
  const RunCounters& c = bench.pipeline.context->counters;
  EXPECT_EQ(c.processed.load(), 11u);
  EXPECT_EQ(c.initializing.load(), 1u);
  EXPECT_EQ(c.posed(), 7u);
  EXPECT_EQ(c.lost.load(), 3u);
  EXPECT_EQ(c.segments.load(), 1u);
  EXPECT_EQ(c.relocalized.load(), 1u);
  EXPECT_GE(c.keyframes.load(), 1u);
  EXPECT_GT(c.static_features.load(), 0u);
  EXPECT_EQ(bench.pipeline.context->track_log.causal.size(), 7u);
}

TEST(TrackFrame, WhatOnlyThePictureAsAWholePosedStaysOutOfTheMap) {
  synthetic::SyntheticLog log({.seed = 2, .people = 0});
  test::ScriptedDriver driver({.name = "room", .width = 640, .height = 480, .fps = 30, .is_log = true}, {});
  Config config = test::synthetic_config();
  config.stream.listen = "off";
  Pipeline pipeline(driver, {}, false, config);
  const auto track = [&](int index, bool blurred) {
    test::Scene scene(log, index);
    if (blurred) test::blur(scene);
    FrameHandle frame = pipeline.stages->frames.acquire();
    FrameSlot& slot = frame.writable();
    std::ranges::copy(scene.truth.colour, slot.colour.data);
    std::ranges::copy(scene.truth.depth, slot.depth.data);
    slot.colour_ns = slot.depth_ns = scene.truth.stamp_ns;
    slot.sequence = static_cast<std::uint64_t>(index);
    return track_frame(*pipeline.context, *frame);
  };
  for (int i = 0; i < 30; ++i) ASSERT_TRUE(track(i, false)) << i;
  const RunCounters& c = pipeline.context->counters;
  const std::uint64_t weak = c.weak.load();
  EXPECT_FALSE(track(30, true));
  EXPECT_EQ(c.weak.load(), weak + 1) << "it has a pose";
  EXPECT_TRUE(track(31, false));
}

TEST(RunOutcome, ARunWithoutAPoseSaysWhy) {
  auto driver = wall_driver(true, {});
  const auto outcome = [&](std::uint64_t processed, const char* resume, bool stop) {
    RunOptions options;
    options.resume = resume;
    Pipeline pipeline(driver, options);
    pipeline.context->counters.processed = processed;
    pipeline.stop = stop;
    const Status status = run_outcome(*pipeline.context);
    if (status.ok()) return std::string();
    EXPECT_EQ(status.error().exit_code, ExitCode::UnreadableInput);
    return status.error().message;
  };
  EXPECT_NE(outcome(0, "", false).find("no frame could be used"), std::string::npos);
  EXPECT_NE(outcome(9, "", false).find("none of 9 frames could be tracked"), std::string::npos);
  EXPECT_NE(outcome(9, "room.stillmap", false).find("--resume was not recognised"), std::string::npos);
  EXPECT_EQ(outcome(9, "", true), "");
}

TEST(AdaptQuality, LateFramesGiveUpDetectorFeaturesAndFusionAndTakeThemBack) {
  TrackFrameBench bench;
  RunContext& context = *bench.pipeline.context;
  int next = 0;
  // One frame that had its pose so long after it was due.
  const auto frame_after = [&](Nanoseconds latency) {
    FrameHandle frame = bench.pipeline.stages->frames.acquire();
    FrameSlot& slot = frame.writable();
    bench.scene.draw(next, slot);
    slot.sequence = static_cast<std::uint64_t>(next++);
    track_frame(context, *frame);
    const std::size_t features = bench.pipeline.stages->track.tracker().features().size();
    frame.writable().due_ns = monotonic_now() - latency;
    adapt_quality(context, *frame, false);
    return features;
  };
  constexpr Nanoseconds kHour = 3'600'000'000'000;
  const std::size_t all = frame_after(0);
  for (int i = 1; i < 30; ++i) frame_after(-kHour);  // warm
  std::vector<int> steps;
  for (int i = 0; i < 24; ++i) {
    frame_after(kHour);
    if (steps.empty() || steps.back() != context.quality.load()) steps.push_back(context.quality.load());
  }
  EXPECT_EQ(steps, (std::vector<int>{0, 1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(quality_now(context).detector_every, 6);
  const std::size_t half = frame_after(-kHour);
  EXPECT_LT(half, all * 6 / 10);
  EXPECT_GT(half, all * 4 / 10);
  for (int i = 0; i < 6 * 90; ++i) frame_after(-kHour);
  EXPECT_EQ(context.quality.load(), 0);
  EXPECT_GT(frame_after(-kHour), all * 9 / 10);
  EXPECT_EQ(context.counters.quality_lowered.load(), 6u);
  EXPECT_EQ(context.counters.quality_raised.load(), 6u);
  EXPECT_GT(context.counters.frames_shed.load(), 500u);
  std::vector<int> told;
  while (const auto e = context.events_of(Stage::Track).try_pop()) {
    if (e->code == EventCode::QualityLowered || e->code == EventCode::QualityRaised)
      told.push_back(static_cast<int>(e->a));
  }
  EXPECT_EQ(told, (std::vector<int>{1, 2, 3, 4, 5, 6, 5, 4, 3, 2, 1, 0}));
}

TEST(TrackFrame, NotesTheTrackersPoolsForOtherThreads) {
  TrackFrameBench bench;
  EXPECT_EQ(bench.pipeline.context->counters.points.name.load(), nullptr);
  bench.track(0, false);
  const PoolMark& points = bench.pipeline.context->counters.points;
  EXPECT_STREQ(points.name.load(), "points");
  EXPECT_GT(points.high_water.load(), 0u);
  EXPECT_EQ(points.capacity.load(), 20'000u);
}

TEST(RunCounters, DropsFromTwoThreadsAreAllCounted) {
  RunCounters counters;
  const auto drop = [&] {
    for (int i = 0; i < 100'000; ++i) counters.drop(DropReason::TrackerBehind);
  };
  std::thread a(drop), b(drop);
  a.join();
  b.join();
  EXPECT_EQ(counters.dropped[static_cast<std::size_t>(DropReason::TrackerBehind)].load(), 200'000u);
}

}  // namespace
}  // namespace stillmap
