// SPDX-License-Identifier: Apache-2.0
#include "runtime/run_context.h"

#include <gtest/gtest.h>

#include "runtime/capture.h"
#include "tests/runtime/pipeline.h"

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
    make_grey(slot.colour, slot.grey);
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
  EXPECT_EQ(c.tracked.load() + c.weak.load(), 7u);
  EXPECT_EQ(c.lost.load(), 3u);
  EXPECT_EQ(c.segments.load(), 1u);
  EXPECT_EQ(c.relocalized.load(), 1u);
  EXPECT_GE(c.keyframes.load(), 1u);
  EXPECT_GT(c.static_features.load(), 0u);
  EXPECT_EQ(bench.pipeline.context->track_log.causal.size(), 7u);
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
