// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <set>
#include <thread>

#include "core/random.h"
#include "tests/runtime/running.h"

namespace stillmap {
namespace {

using test::Gate;
using test::kStopDeadline_s;
using test::PatientCamera;
using test::Pipeline;
using test::Running;
using test::wait_until;
using test::wall_driver;
using test::wall_frames;
using test::WallScene;
using Grab = test::ScriptedDriver::Grab;

constexpr Nanoseconds kMillisecond = 1'000'000, kHour = 3'600'000'000'000;

TEST(Threads, ALogEndsWithEveryFrameAccounted) {
  for (const bool with_detector : {false, true}) {
    const RunCounters* counters = nullptr;
    int decoded = 0;
    auto driver = wall_driver(true, wall_frames(45), [&] {
      if (++decoded == 45) wait_until([&] { return !with_detector || counters->detector_runs.load() > 0; });
    });
    Pipeline pipeline(driver, {}, with_detector);
    counters = &pipeline.context->counters;
    const Nanoseconds begin = monotonic_now();
    run_threads(*pipeline.context);
    EXPECT_GE(to_seconds(monotonic_now() - begin), 44 / 30.0);  // on the wall clock
    EXPECT_EQ(pipeline.context->counters.offered.load(), 45u);
    EXPECT_GT(pipeline.context->counters.processed.load(), 0u);
    EXPECT_EQ(pipeline.dropped(), pipeline.dropped(DropReason::TrackerBehind));
    EXPECT_TRUE(run_outcome(*pipeline.context).ok());
    EXPECT_EQ(pipeline.context->counters.detector_runs.load() > 0, with_detector);
    if (!with_detector) {  // its frames may all be ones that a busy machine has not tracked
      EXPECT_GT(pipeline.stages->map.map().fused_frames(), 0u);
    }
    pipeline.expect_accounted();
  }
}

TEST(Threads, ALogThatIsDecodedSlowlyHoldsTheClockBackAndNobodyIsLateForIt) {
  std::vector<Grab> grabs = wall_frames(40);
  for (std::size_t i = 0; i < grabs.size(); ++i)
    grabs[i].stamp_ns = (static_cast<Nanoseconds>(i) + 1) * kMillisecond;
  auto driver = wall_driver(true, grabs, [] { std::this_thread::sleep_for(std::chrono::milliseconds(20)); });
  Pipeline pipeline(driver);
  const Nanoseconds begin = monotonic_now();
  run_threads(*pipeline.context);
  const double wall_s = to_seconds(monotonic_now() - begin);
  const RunCounters& c = pipeline.context->counters;
  const double held_back_s = 1e-9 * static_cast<double>(c.held_back_ns.load());
  EXPECT_GT(held_back_s, 0.3);
  EXPECT_GE(wall_s, held_back_s + 0.038);
  // Each frame was later than the one before: together twenty times as long as the run.
  EXPECT_LT(1e-6 * static_cast<double>(c.latency_us.load()), 4 * wall_s);
  pipeline.expect_accounted();
}

TEST(Threads, StopsWithinTwoSecondsAtAnyMoment) {
  Random random(static_cast<std::uint64_t>(monotonic_now()));
  for (int round = 0; round < 20; ++round) {
    auto driver = wall_driver(true, wall_frames(100'000));
    Pipeline pipeline(driver, {}, round % 2 == 0);
    Running running(pipeline);
    const std::uint32_t after_us = random.below(300'000);
    std::this_thread::sleep_for(std::chrono::microseconds(after_us));
    EXPECT_LT(running.stop_s(), kStopDeadline_s) << "asked after " << after_us << " us";
    EXPECT_TRUE(run_outcome(*pipeline.context).ok());
    pipeline.expect_accounted();
  }
}

TEST(Threads, StopsWithinAPauseOfTheLog) {
  std::vector<Grab> grabs = wall_frames(4);
  for (std::size_t i = 2; i < grabs.size(); ++i) grabs[i].stamp_ns += kHour;
  auto driver = wall_driver(true, grabs);
  Pipeline pipeline(driver);
  Running running(pipeline);
  running.wait_for_frames(2);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_LT(running.stop_s(), kStopDeadline_s);
  pipeline.expect_accounted();
}

TEST(Threads, ACameraThatStallsAndComesBackLosesNothing) {
  std::vector<Grab> grabs = wall_frames(20);
  for (int i = 0; i < 3; ++i)
    grabs.insert(grabs.begin() + 10, {.status = GrabStatus::Timeout, .takes_ns = kHour});
  PatientCamera camera(grabs);
  Pipeline pipeline(camera.driver);
  camera.pipeline = &pipeline;
  run_threads(*pipeline.context);
  EXPECT_EQ(pipeline.context->counters.offered.load(), 20u);
  EXPECT_EQ(pipeline.context->track_log.causal.size(), 20u);
  pipeline.expect_accounted();
}

TEST(Threads, StopsWhileTheCameraIsSilent) {
  std::vector<Grab> grabs = wall_frames(2);
  grabs.insert(grabs.end(), 10'000, {.status = GrabStatus::Timeout, .takes_ns = kHour});
  auto driver = wall_driver(false, grabs);
  Pipeline pipeline(driver);
  Running running(pipeline);
  running.wait_for_frames(1);
  EXPECT_LT(running.stop_s(), kStopDeadline_s);
  pipeline.expect_accounted();
}

TEST(Threads, ALostCameraEndsTheRunAndFailsIt) {
  std::vector<Grab> grabs = wall_frames(10);
  for (Grab& g : grabs) g.takes_ns = 20 * kMillisecond;
  grabs.push_back({.status = GrabStatus::Lost});
  auto driver = wall_driver(false, grabs);
  RunOptions options;
  options.source = "wall:0";
  Pipeline pipeline(driver, options, true);
  run_threads(*pipeline.context);
  const Status outcome = run_outcome(*pipeline.context);
  ASSERT_FALSE(outcome.ok());
  EXPECT_EQ(outcome.error().exit_code, ExitCode::RunFailed);
  EXPECT_THAT(outcome.error().message, ::testing::AllOf(::testing::StartsWith("wall:0: the source is gone; "),
                                                        ::testing::Not(::testing::HasSubstr("\n"))));
  pipeline.expect_accounted();
}

TEST(Threads, DropsRepeatsAndJumpsInTimeAreCounted) {
  std::vector<Grab> grabs = wall_frames(30);
  grabs[5] = {.status = GrabStatus::Dropped, .reason = DropReason::CorruptDepth};
  grabs[8].stamp_ns = grabs[7].stamp_ns;  // repeated
  grabs[9].stamp_ns = grabs[2].stamp_ns;  // back
  grabs[10].stamp_ns = 0;
  for (std::size_t i = 20; i < grabs.size(); ++i) grabs[i].stamp_ns += kHour;
  PatientCamera camera(grabs);
  Pipeline pipeline(camera.driver);
  camera.pipeline = &pipeline;
  run_threads(*pipeline.context);
  EXPECT_EQ(pipeline.context->counters.offered.load(), 30u);
  EXPECT_EQ(pipeline.context->counters.processed.load(), 26u);
  EXPECT_EQ(pipeline.dropped(DropReason::CorruptDepth), 1u);
  EXPECT_EQ(pipeline.dropped(DropReason::TimeJump), 3u);
  ASSERT_FALSE(pipeline.context->track_log.causal.empty());
  EXPECT_GT(pipeline.context->track_log.causal.end()[-1].stamp_ns, kHour);  // tracked on after the jump
  pipeline.expect_accounted();
}

TEST(Threads, ABurstIsThinnedOutNotQueued) {
  auto driver = wall_driver(false, wall_frames(200));  // as fast as they are drawn
  Pipeline pipeline(driver);
  Gate gate(*pipeline.context);
  gate.hold(Stage::Track);
  Running running(pipeline);
  wait_until([&] { return pipeline.context->counters.offered.load() >= 50; });
  gate.release_all();
  running.thread.join();
  EXPECT_EQ(pipeline.context->counters.offered.load(), 200u);
  EXPECT_GT(pipeline.dropped(DropReason::TrackerBehind), 0u);
  pipeline.expect_accounted();
}

TEST(Threads, FastTracksEveryFrameInOrder) {
  for (const bool with_detector : {false, true}) {
    auto driver = wall_driver(true, wall_frames(200));
    RunOptions options;
    options.mode = RunMode::Fast;
    Pipeline pipeline(driver, options, with_detector);
    run_threads(*pipeline.context);
    EXPECT_EQ(pipeline.context->counters.processed.load(), 200u);
    EXPECT_EQ(pipeline.dropped(), 0u);
    EXPECT_EQ(pipeline.context->track_log.causal.size(), 200u);
    if (!with_detector) {
      EXPECT_EQ(pipeline.stages->map.map().fused_frames(), 100u);  // every second, none lost on the way
    }
    pipeline.expect_accounted();
  }
}

TEST(Threads, FastStopsWithinTwoSecondsAndCountsWhatWasOffered) {
  Random random(static_cast<std::uint64_t>(monotonic_now()));
  for (int round = 0; round < 10; ++round) {
    auto driver = wall_driver(true, wall_frames(100'000));
    RunOptions options;
    options.mode = RunMode::Fast;
    Pipeline pipeline(driver, options);
    Running running(pipeline);
    const std::uint32_t after_us = random.below(200'000);
    std::this_thread::sleep_for(std::chrono::microseconds(after_us));
    EXPECT_LT(running.stop_s(), kStopDeadline_s) << "asked after " << after_us << " us";
    EXPECT_EQ(pipeline.dropped(), 0u);
    pipeline.expect_accounted();
  }
}

TEST(Threads, CaptureNeverStarvesWhileEveryConsumerHoldsAllItMay) {
  std::vector<Grab> grabs = wall_frames(100'000);
  for (Grab& g : grabs) g.takes_ns = 2 * kMillisecond;
  auto driver = wall_driver(false, grabs);
  Pipeline pipeline(driver, {}, true);
  RunContext& context = *pipeline.context;
  Gate gate(context);
  Running running(pipeline);
  running.wait_for_frames(1);
  gate.hold(Stage::Detect);
  gate.hold(Stage::Map);
  const std::uint64_t tracked = context.counters.processed.load();
  running.wait_for_frames(tracked + 8);  // whatever the map's ring has no room for is not waited for
  gate.hold(Stage::Track);
  const std::uint64_t offered = context.counters.offered.load();
  wait_until([&] { return context.counters.offered.load() >= offered + 30; });
  EXPECT_EQ(pipeline.dropped(DropReason::NoFreeSlot), 0u);
  EXPECT_GT(pipeline.dropped(DropReason::TrackerBehind), 0u);
  gate.release_all();
  EXPECT_LT(running.stop_s(), kStopDeadline_s);
  EXPECT_GT(context.counters.map_ring.refused.load(), 0u);
  EXPECT_EQ(pipeline.dropped(DropReason::NoFreeSlot), 0u);
  pipeline.expect_accounted();
}

TEST(Threads, EachStageThatIsHeldUpIsNamedAndTheRunGoesOn) {
  for (const Stage stage : {Stage::Capture, Stage::Track, Stage::Detect, Stage::Map}) {
    auto driver = wall_driver(true, wall_frames(100'000));
    Pipeline pipeline(driver, {}, true);
    RunContext& context = *pipeline.context;
    Gate gate(context);
    Running running(pipeline);
    running.wait_for_frames(2);
    gate.hold(stage);
    const auto late = [&](Stage s) { return context.counters.late[static_cast<std::size_t>(s)].load(); };
    wait_until([&] { return late(stage) > 0; });
    gate.release_all();
    const std::uint64_t before = context.counters.processed.load();
    running.wait_for_frames(before + 5);
    EXPECT_LT(running.stop_s(), kStopDeadline_s) << to_string(stage);
    pipeline.expect_accounted();
  }
}

TEST(Threads, TheEndOfTheStreamComesThroughFullRings) {
  for (const RunMode mode : {RunMode::Realtime, RunMode::Fast}) {
    auto driver = wall_driver(true, wall_frames(40));
    RunOptions options;
    options.mode = mode;
    Pipeline pipeline(driver, options);
    Gate gate(*pipeline.context);
    gate.hold(Stage::Map);
    gate.hold(Stage::Track);
    Running running(pipeline);
    wait_until([&] { return pipeline.context->counters.offered.load() >= 5; });
    gate.release_all();
    running.thread.join();
    EXPECT_EQ(pipeline.context->counters.offered.load(), 40u);
    if (mode == RunMode::Fast) {
      EXPECT_EQ(pipeline.context->counters.processed.load(), 40u);
    }
    pipeline.expect_accounted();
  }
}

TEST(Threads, HaveTheirNames) {
  Config config = WallScene::config();
  config.stream.listen = "127.0.0.1:0";
  auto driver = wall_driver(true, wall_frames(100'000));
  Pipeline pipeline(driver, {}, true, config);
  ASSERT_TRUE(pipeline.stages->stream->open().ok());
  Running running(pipeline);
  std::multiset<std::string> names;
  const auto all_are_named = [&] {
    names.clear();
    for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
      std::string name;
      std::getline(std::ifstream(task.path() / "comm") >> std::ws, name);
      names.insert(name);
    }
    constexpr std::array kNames{"decode", "capture", "track", "adjust", "map", "detect", "stream"};
    return std::ranges::all_of(kNames, [&](const char* name) { return names.count(name) == 1; });
  };
  // A thread takes its name when it first gets a processor.
  const Nanoseconds begin = monotonic_now();
  wait_until([&] { return all_are_named() || to_seconds(monotonic_now() - begin) > 60; });
  EXPECT_TRUE(all_are_named()) << ::testing::PrintToString(names);
  EXPECT_LT(running.stop_s(), kStopDeadline_s);
  pipeline.stages->stream->stop();
}

}  // namespace
}  // namespace stillmap
