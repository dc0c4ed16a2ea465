// SPDX-License-Identifier: Apache-2.0
#include "runtime/capture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <vector>

#include "tests/runtime/scripted_driver.h"

namespace stillmap {
namespace {

using test::ScriptedDriver;
using Grab = ScriptedDriver::Grab;

constexpr int kWidth = 32, kHeight = 16, kFrames = 4;
constexpr Nanoseconds kFrame_ns = 33'000'000;

/// A capture from a scripted source into a pool of kFrames frames.
struct Bench {
  Bench(std::vector<Grab> grabs, bool is_log, double duration_s = 0, bool monotonic = false)
      : arena(1 << 20),
        pool(arena, kFrames, kWidth, kHeight),
        driver({.name = "scripted",
                .width = kWidth,
                .height = kHeight,
                .is_log = is_log,
                .monotonic_stamps = monotonic},
               std::move(grabs),
               [](int picture, FrameSlot& slot) {
                 slot.colour.at(0, 0) = {static_cast<std::uint8_t>(picture), 0, 0};
               }),
        capture(driver, CameraModel{}, pool, counters, log, events, duration_s) {}
  Capture::Outcome next(FrameHandle& out) { return capture.next(out, monotonic_now()); }
  std::uint64_t dropped(DropReason reason) const {
    return counters.dropped[static_cast<std::size_t>(reason)].load();
  }

  Arena arena;
  FramePool pool;
  RunCounters counters;
  CaptureLog log;
  EventRing events;
  ScriptedDriver driver;
  Capture capture;
};

std::vector<Grab> frames(int count) {
  std::vector<Grab> grabs;
  for (int i = 0; i < count; ++i) grabs.push_back({.stamp_ns = (i + 1) * kFrame_ns, .picture = i});
  return grabs;
}

TEST(Capture, NumbersFrames) {
  Bench bench(frames(3), true);
  for (std::uint64_t i = 0; i < 3; ++i) {
    FrameHandle frame;
    const Nanoseconds before = monotonic_now();
    ASSERT_EQ(bench.next(frame), Capture::Outcome::Frame);
    EXPECT_EQ(frame->sequence, i);
    EXPECT_EQ(frame->colour_ns, static_cast<Nanoseconds>(i + 1) * kFrame_ns);
    EXPECT_GE(frame->due_ns, before);
    EXPECT_EQ(frame->colour.at(0, 0).b, i);
  }
  FrameHandle none;
  EXPECT_EQ(bench.next(none), Capture::Outcome::End);
  EXPECT_FALSE(none);
  EXPECT_EQ(bench.counters.offered.load(), 3u);
  EXPECT_EQ(bench.log.decode_time.count(), 3u);
}

TEST(Capture, CountsEachReasonAndLeavesAGapInTheNumbers) {
  Bench bench({{.stamp_ns = 1},
               {.status = GrabStatus::Dropped, .reason = DropReason::MissingFile},
               {.status = GrabStatus::Dropped, .reason = DropReason::CorruptDepth},
               {.status = GrabStatus::Timeout},
               {.stamp_ns = 2},
               {.status = GrabStatus::Lost}},
              true);
  FrameHandle frame;
  ASSERT_EQ(bench.next(frame), Capture::Outcome::Frame);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(bench.next(frame), Capture::Outcome::Nothing);
  ASSERT_EQ(bench.next(frame), Capture::Outcome::Frame);
  EXPECT_EQ(frame->sequence, 3u);
  EXPECT_EQ(bench.next(frame), Capture::Outcome::Lost);
  EXPECT_EQ(bench.counters.offered.load(), 4u);
  EXPECT_EQ(bench.dropped(DropReason::MissingFile), 1u);
  EXPECT_EQ(bench.dropped(DropReason::CorruptDepth), 1u);
  EXPECT_EQ(bench.dropped(DropReason::CorruptColour), 0u);
}

TEST(Capture, StampsThatDoNotRiseAreDropped) {
  Bench bench({{.stamp_ns = 0},
               {.stamp_ns = 0},
               {.stamp_ns = 50},
               {.stamp_ns = 40},
               {.stamp_ns = 50},
               {.stamp_ns = 51}},
              false);
  std::vector<Nanoseconds> stamps;
  for (int i = 0; i < 6; ++i) {
    FrameHandle frame;
    if (bench.next(frame) == Capture::Outcome::Frame) stamps.push_back(frame->colour_ns);
  }
  EXPECT_EQ(stamps, (std::vector<Nanoseconds>{0, 50, 51}));
  EXPECT_EQ(bench.dropped(DropReason::TimeJump), 3u);
  EXPECT_EQ(bench.counters.offered.load(), 6u);
}

/// `count` frames at the camera's rate, the first at `begin_ns`.
void add_frames(std::vector<Grab>& grabs, Nanoseconds begin_ns, int count) {
  for (int i = 0; i < count; ++i) grabs.push_back({.stamp_ns = begin_ns + i * kFrame_ns});
}

/// The stamps of the frames that come out.
std::vector<Nanoseconds> stamps_of(Bench& bench) {
  std::vector<Nanoseconds> stamps;
  for (Capture::Outcome outcome = Capture::Outcome::Nothing; outcome != Capture::Outcome::End;) {
    FrameHandle frame;
    outcome = bench.next(frame);
    if (outcome == Capture::Outcome::Frame) stamps.push_back(frame->colour_ns);
  }
  return stamps;
}

constexpr Nanoseconds kHour = 3'600'000'000'000, kNow = 1'790'000'000'000'000'000;

TEST(Capture, ACamerasClockThatIsSetBackCostsASecond) {
  std::vector<Grab> grabs;
  add_frames(grabs, kNow, 10);
  add_frames(grabs, kNow - kHour, 100);
  add_frames(grabs, kNow - 2 * kHour, 100);  // and once more
  Bench bench(grabs, false);
  const std::vector<Nanoseconds> stamps = stamps_of(bench);
  ASSERT_EQ(stamps.size(), 210u - 2 * 30);
  for (std::size_t i = 0; i < stamps.size(); ++i)
    EXPECT_EQ(stamps[i], kNow + static_cast<Nanoseconds>(i) * kFrame_ns) << i;
  EXPECT_EQ(bench.dropped(DropReason::TimeJump), 60u);
  EXPECT_EQ(bench.counters.offered.load(), 210u);
  int told = 0;
  while (const std::optional<Event> event = bench.events.try_pop()) {
    if (event->code != EventCode::SourceTimeJump) continue;  // the frames have no depth, either
    EXPECT_NEAR(static_cast<double>(event->a), -to_ms(kHour), 5000);
    ++told;
  }
  EXPECT_EQ(told, 2);
}

TEST(Capture, ACamerasClockThatIsPutOnIsTold) {
  std::vector<Grab> grabs;
  add_frames(grabs, kNow, 10);
  add_frames(grabs, kNow + kHour, 10);
  Bench bench(grabs, false);
  EXPECT_EQ(stamps_of(bench).size(), 20u);
  const std::optional<Event> told = bench.events.try_pop();
  ASSERT_TRUE(told.has_value());
  EXPECT_EQ(told->code, EventCode::SourceTimeJump);
  EXPECT_EQ(told->sequence, 9u) << "after this frame";
  EXPECT_NEAR(static_cast<double>(told->a), to_ms(kHour), 5000);
  EXPECT_FALSE(bench.events.try_pop().has_value());
}

TEST(Capture, AStampFromTheFutureCostsASecondNotAnHour) {
  for (const Nanoseconds ahead : {kHour, Nanoseconds{1} << 62, std::numeric_limits<Nanoseconds>::max()}) {
    std::vector<Grab> grabs;
    add_frames(grabs, kNow, 10);
    grabs.push_back({.stamp_ns = ahead == kHour ? kNow + kHour : ahead});
    add_frames(grabs, kNow + 11 * kFrame_ns, 60);
    Bench bench(grabs, false);
    const std::vector<Nanoseconds> stamps = stamps_of(bench);
    EXPECT_EQ(stamps.size(), ahead == kHour ? 71u - 30 : 70u) << "nonsense is only dropped";
    EXPECT_TRUE(std::ranges::is_sorted(stamps));
  }
}

TEST(Capture, NonsenseAtFirstIsDroppedToo) {
  std::vector<Grab> grabs{{.stamp_ns = std::numeric_limits<Nanoseconds>::max()},
                          {.stamp_ns = std::numeric_limits<Nanoseconds>::min()}};
  add_frames(grabs, kNow, 40);
  Bench bench(grabs, false);
  EXPECT_EQ(stamps_of(bench).size(), 40u);
}

TEST(Capture, NonsenseOfDepthIsDroppedToo) {
  class DepthAhead : public ScriptedDriver {
   public:
    using ScriptedDriver::ScriptedDriver;
    GrabResult grab(FrameSlot& slot, Nanoseconds deadline_ns) override {
      const GrabResult result = ScriptedDriver::grab(slot, deadline_ns);
      if (++grabs_ % 2 == 0) slot.depth_ns = std::numeric_limits<Nanoseconds>::max();
      return result;
    }

   private:
    int grabs_ = 0;
  };
  Bench bench({}, true);
  DepthAhead driver({.name = "ahead", .width = kWidth, .height = kHeight, .is_log = true}, frames(10));
  Capture capture(driver, CameraModel{}, bench.pool, bench.counters, bench.log, bench.events, 0);
  FrameHandle frame;
  int taken = 0;
  for (int i = 0; i < 10; ++i) taken += capture.next(frame, monotonic_now()) == Capture::Outcome::Frame;
  EXPECT_EQ(taken, 5);
  EXPECT_EQ(bench.dropped(DropReason::TimeJump), 5u);
}

TEST(Capture, ALogsStampsAreAsTheyAre) {
  std::vector<Grab> grabs;
  add_frames(grabs, kNow, 10);
  add_frames(grabs, kNow - kHour, 100);
  Bench bench(grabs, true);
  EXPECT_EQ(stamps_of(bench).size(), 10u);
  EXPECT_EQ(bench.dropped(DropReason::TimeJump), 100u);
}

TEST(Capture, ACameraIsReadWhileThePoolIsExhausted) {
  Bench bench(frames(10), false);
  std::vector<FrameHandle> held;
  for (int i = 0; i < 8; ++i) {
    FrameHandle frame;
    const bool free = i < kFrames - 1;
    ASSERT_EQ(bench.next(frame), free ? Capture::Outcome::Frame : Capture::Outcome::Nothing) << i;
    if (frame) held.push_back(std::move(frame));
    EXPECT_EQ(bench.driver.grabbed(),
              static_cast<std::size_t>(i + 1));  // one frame of the camera for each call
  }
  EXPECT_EQ(bench.dropped(DropReason::NoFreeSlot), 5u);
  EXPECT_EQ(bench.counters.offered.load(), 8u);
  held.pop_back();
  FrameHandle frame;
  ASSERT_EQ(bench.next(frame), Capture::Outcome::Frame);
  EXPECT_EQ(frame->sequence, 8u);
  EXPECT_EQ(frame->colour.at(0, 0).b, 8);  // the newest, not one that waited
}

TEST(Capture, ALogWaitsForThePool) {
  Bench bench(frames(10), true);
  std::vector<FrameHandle> held;
  for (int i = 0; i < 8; ++i) {
    FrameHandle frame;
    if (bench.next(frame) == Capture::Outcome::Frame) held.push_back(std::move(frame));
  }
  EXPECT_EQ(held.size(), static_cast<std::size_t>(kFrames));
  EXPECT_EQ(bench.counters.offered.load(), held.size());  // the one that waits is not offered yet
  for (std::uint64_t i = held.size(); i < 10; ++i) {
    held.erase(held.begin());
    FrameHandle frame;
    ASSERT_EQ(bench.next(frame), Capture::Outcome::Frame) << i;
    EXPECT_EQ(frame->sequence, i);
    EXPECT_EQ(frame->colour.at(0, 0).b, i);
    held.push_back(std::move(frame));
  }
  held.clear();
  FrameHandle none;
  EXPECT_EQ(bench.next(none), Capture::Outcome::End);
  EXPECT_EQ(bench.counters.offered.load(), 10u);
  for (const auto& count : bench.counters.dropped) EXPECT_EQ(count.load(), 0u);
}

TEST(Capture, DepthThatCannotBeRightIsToldOnce) {
  Bench bench(frames(250), false);
  for (int i = 0; i < 250; ++i) {
    FrameHandle frame;
    ASSERT_EQ(bench.next(frame), Capture::Outcome::Frame);
    for (int y = 0; y < kHeight; ++y) std::fill_n(frame.writable().depth.row(y), kWidth, std::uint16_t{0});
  }
  const std::optional<Event> told = bench.events.try_pop();
  ASSERT_TRUE(told.has_value());
  EXPECT_EQ(told->code, EventCode::DepthEmpty);
  EXPECT_EQ(told->stage, Stage::Capture);
  EXPECT_EQ(told->sequence, 90u) << "the tenth look, at every tenth frame";
  EXPECT_EQ(told->a, 100);
  EXPECT_FALSE(bench.events.try_pop().has_value());
}

TEST(Capture, OfACamerasFramesTheWayToTheSlotIsTimed) {
  const Nanoseconds now = monotonic_now();
  for (const bool monotonic : {true, false}) {
    Bench bench({{.stamp_ns = now - 80'000'000}, {.stamp_ns = now - 40'000'000}}, false, 0, monotonic);
    FrameHandle frame;
    for (int i = 0; i < 2; ++i) ASSERT_EQ(bench.next(frame), Capture::Outcome::Frame);
    EXPECT_EQ(bench.log.stamp_to_slot.count(), monotonic ? 2u : 0u);
    if (monotonic) {
      EXPECT_GE(bench.log.stamp_to_slot.quantile_ms(0.5), 40);
      EXPECT_GE(bench.log.stamp_to_slot.max_ms(), 80);
    }
  }
}

TEST(Capture, EndsAfterItsDurationWithoutCountingTheFrameBeyond) {
  Bench bench(frames(10), true, 2.5 * to_seconds(kFrame_ns));
  int count = 0;
  for (FrameHandle frame; bench.next(frame) == Capture::Outcome::Frame;) ++count;
  EXPECT_EQ(count, 3);
  EXPECT_EQ(bench.counters.offered.load(), 3u);
}

}  // namespace
}  // namespace stillmap
