// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <cstring>
#include <thread>

#include "tests/runtime/pipeline.h"

namespace stillmap {
namespace {

using test::Pipeline;
using test::wall_driver;
using test::wall_frames;
using test::WallScene;
using Grab = test::ScriptedDriver::Grab;

constexpr int kFrames = 30;

struct Finished {
  std::vector<StampedPose> poses;
  std::vector<OccupiedVoxel> voxels;
  BoxSupply boxes;
  FuseCounts fused;
  std::uint64_t detector_runs = 0;
};

Finished run_once(int delay, int every, bool with_detector) {
  auto driver = wall_driver(true, wall_frames(kFrames));
  RunOptions options;
  options.detector = {delay, every};
  Pipeline pipeline(driver, options, with_detector);
  run_lockstep(*pipeline.context);
  pipeline.expect_accounted();
  EXPECT_EQ(pipeline.context->counters.processed.load(), static_cast<std::uint64_t>(kFrames));
  EXPECT_TRUE(run_outcome(*pipeline.context).ok());
  const auto& causal = pipeline.context->track_log.causal;
  Finished out{{causal.begin(), causal.end()},
               {},
               pipeline.stages->track.box_supply(),
               pipeline.stages->map.counts(),
               pipeline.context->counters.detector_runs.load()};
  pipeline.stages->map.map().for_each_occupied([&](const OccupiedVoxel& v) { out.voxels.push_back(v); });
  return out;
}

void expect_same(const Finished& a, const Finished& b) {
  ASSERT_EQ(a.poses.size(), b.poses.size());
  for (std::size_t i = 0; i < a.poses.size(); ++i) {
    EXPECT_EQ(std::memcmp(&a.poses[i].T_world_camera, &b.poses[i].T_world_camera, sizeof(Pose)), 0) << i;
  }
  ASSERT_EQ(a.voxels.size(), b.voxels.size());
  for (std::size_t i = 0; i < a.voxels.size(); ++i) {
    const OccupiedVoxel &v = a.voxels[i], &w = b.voxels[i];
    EXPECT_TRUE(v.x == w.x && v.y == w.y && v.z == w.z && v.colour.g == w.colour.g) << i;
  }
}

TEST(Lockstep, IsTheSameTwiceWithoutADetector) {
  const Finished a = run_once(0, 1, false);
  expect_same(a, run_once(0, 1, false));
  EXPECT_EQ(a.poses.size(), static_cast<std::size_t>(kFrames));
  EXPECT_EQ(a.fused.carried_boxes, static_cast<std::uint64_t>(kFrames / 2));
}

TEST(Lockstep, IsTheSameTwiceWithADetectorThatIsLateAndSeldom) {
  const Finished a = run_once(5, 3, true);
  expect_same(a, run_once(5, 3, true));
  EXPECT_EQ(a.detector_runs, 10u);
  EXPECT_EQ(a.boxes.fresh, 0u);
  EXPECT_EQ(a.boxes.none, 5u);       // before the first word
  EXPECT_EQ(a.fused.own_boxes, 9u);  // the words on frames 0 to 24; those after come when the log has ended
  EXPECT_EQ(a.fused.carried_boxes, 0u);
}

TEST(Lockstep, BoxesWithoutDelayAreTheFramesOwn) {
  const Finished a = run_once(0, 1, true);
  EXPECT_EQ(a.boxes.fresh, static_cast<std::uint64_t>(kFrames));
  EXPECT_EQ(a.fused.own_boxes, static_cast<std::uint64_t>(kFrames / 2));
  EXPECT_EQ(a.fused.unposed, 0u);
}

TEST(Lockstep, TheLongestDelayHasItsFrames) {
  const Finished a = run_once(60, 1, true);  // no word comes before the log's end
  EXPECT_EQ(a.boxes.none, static_cast<std::uint64_t>(kFrames));
}

TEST(Lockstep, ALostSourceFailsTheRunWithItsResults) {
  std::vector<Grab> grabs = wall_frames(5);
  grabs.push_back({.status = GrabStatus::Lost});
  auto driver = wall_driver(false, grabs);
  RunOptions options;
  options.source = "wall:";
  Pipeline pipeline(driver, options);
  run_lockstep(*pipeline.context);
  const Status outcome = run_outcome(*pipeline.context);
  ASSERT_FALSE(outcome.ok());
  EXPECT_EQ(outcome.error().exit_code, ExitCode::RunFailed);
  EXPECT_THAT(outcome.error().message, ::testing::StartsWith("wall:: the source is gone; check"));
  EXPECT_EQ(pipeline.context->track_log.causal.size(), 5u);
  pipeline.expect_accounted();
}

TEST(Lockstep, NoUsableFrameIsUnreadableInput) {
  auto driver = wall_driver(true, std::vector<Grab>(3, {.status = GrabStatus::Dropped}));
  Pipeline pipeline(driver);
  run_lockstep(*pipeline.context);
  const Status outcome = run_outcome(*pipeline.context);
  ASSERT_FALSE(outcome.ok());
  EXPECT_EQ(outcome.error().exit_code, ExitCode::UnreadableInput);
  pipeline.expect_accounted();
}

TEST(Lockstep, NeverSheds) {
  Config config = WallScene::config();
  config.mount.fps = 240;  // a deadline that no frame keeps
  auto driver = wall_driver(true, wall_frames(60));
  Pipeline pipeline(driver, {}, false, config);
  pipeline.context->on_work = [](Stage) { ADD_FAILURE() << "no threads, no watchdog"; };
  run_lockstep(*pipeline.context);
  EXPECT_EQ(pipeline.context->counters.quality_lowered.load(), 0u);
  EXPECT_EQ(pipeline.context->counters.frames_shed.load(), 0u);
  EXPECT_EQ(pipeline.context->quality.load(), 0);
}

TEST(Lockstep, EndsWhenAsked) {
  auto driver = wall_driver(true, wall_frames(100'000));
  Pipeline pipeline(driver);
  std::thread run([&] { run_lockstep(*pipeline.context); });
  while (pipeline.context->counters.processed.load() < 3) std::this_thread::yield();
  pipeline.stop.store(true);
  run.join();
  EXPECT_LT(pipeline.context->counters.processed.load(), 100'000u);
  EXPECT_TRUE(run_outcome(*pipeline.context).ok());
  pipeline.expect_accounted();
}

TEST(Lockstep, DurationCountsTheSourcesTime) {
  auto driver = wall_driver(true, wall_frames(kFrames));
  RunOptions options;
  options.duration_s = 10.5 / 30;
  Pipeline pipeline(driver, options);
  run_lockstep(*pipeline.context);
  EXPECT_EQ(pipeline.context->counters.processed.load(), 11u);
  pipeline.expect_accounted();
}

}  // namespace
}  // namespace stillmap
