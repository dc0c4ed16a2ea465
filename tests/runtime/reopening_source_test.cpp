// SPDX-License-Identifier: Apache-2.0
#include "runtime/reopening_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/runtime/pipeline.h"

namespace stillmap {
namespace {

using Grab = test::ScriptedDriver::Grab;

/// What the cameras do that are opened one after another; the last one for ever.
struct Plug {
  std::vector<std::vector<Grab>> cameras;  ///< none: this one does not open
  std::size_t opened = 0;
  SourceInfo info{.name = "camera", .width = 4, .height = 4, .fps = 30};
  test::ScriptedDriver::Fill fill = [](int, FrameSlot&) {};

  class Camera : public test::ScriptedDriver {
   public:
    Camera(const Plug& plug, std::vector<Grab> grabs)
        : ScriptedDriver(plug.info, grabs, plug.fill), absent_(grabs.empty()) {}
    Status open() override {
      if (absent_) return Error{ExitCode::RunFailed, "no such camera"};
      return {};
    }

   private:
    bool absent_;
  };
  ReopeningSource::Factory factory() {
    return [this] {
      const std::vector<Grab>& grabs = cameras[std::min(opened++, cameras.size() - 1)];
      return std::make_unique<Camera>(*this, grabs);
    };
  }
};

constexpr Grab kLost{.status = GrabStatus::Lost};
constexpr Grab kSilent{.status = GrabStatus::Timeout, .takes_ns = 20'000'000};

std::vector<EventCode> codes(EventRing& events) {
  std::vector<EventCode> all;
  while (auto event = events.try_pop()) all.push_back(event->code);
  return all;
}

/// Grabs until a frame or the end, at most for five seconds.
GrabStatus next_outcome(ReopeningSource& source) {
  FrameSlot slot;
  const Nanoseconds end = monotonic_now() + 5'000'000'000;
  while (monotonic_now() < end) {
    const GrabResult r = source.grab(slot, monotonic_now() + 20'000'000);
    if (r.status != GrabStatus::Timeout) return r.status;
  }
  return GrabStatus::Timeout;
}

TEST(ReopeningSource, OpensAnUnpluggedCameraAgain) {
  Plug plug{{{{.stamp_ns = 1}, kLost}, {}, {{.stamp_ns = 2}, kLost}, {{.stamp_ns = 3}}}};
  EventRing events;
  ReopeningSource source(plug.factory(), {.stall_s = 1, .give_up_s = 30}, events);
  ASSERT_TRUE(source.open().ok());
  ASSERT_TRUE(source.start().ok());
  EXPECT_EQ(source.describe().name, "camera");
  EXPECT_EQ(next_outcome(source), GrabStatus::Frame);
  EXPECT_EQ(next_outcome(source), GrabStatus::Frame) << "the second did not open, the third did";
  EXPECT_EQ(next_outcome(source), GrabStatus::Frame);
  EXPECT_EQ(plug.opened, 4u);
  EXPECT_THAT(codes(events), testing::ElementsAre(EventCode::SourceGone, EventCode::SourceBack,
                                                  EventCode::SourceGone, EventCode::SourceBack));
}

TEST(ReopeningSource, OpensASilentCameraAgain) {
  Plug plug{{{{.stamp_ns = 1}, kSilent, kSilent, kSilent, kSilent, kSilent, kSilent, kSilent, kSilent},
             {{.stamp_ns = 2}}}};
  EventRing events;
  ReopeningSource source(plug.factory(), {.stall_s = 0.1, .give_up_s = 30}, events);
  ASSERT_TRUE(source.open().ok());
  ASSERT_TRUE(source.start().ok());
  EXPECT_EQ(next_outcome(source), GrabStatus::Frame);
  EXPECT_EQ(next_outcome(source), GrabStatus::Frame);
  EXPECT_THAT(codes(events), testing::ElementsAre(EventCode::SourceStalled, EventCode::SourceBack));
}

TEST(ReopeningSource, ACameraOfAnotherSizeIsNotTakenForIt) {
  Plug plug{{{{.stamp_ns = 1}, kLost}, {{.stamp_ns = 2}}}};
  EventRing events;
  ReopeningSource source(plug.factory(), {.stall_s = 1, .give_up_s = 0.4}, events);
  ASSERT_TRUE(source.open().ok());
  ASSERT_TRUE(source.start().ok());
  EXPECT_EQ(next_outcome(source), GrabStatus::Frame);
  plug.info.width = 8;
  EXPECT_EQ(next_outcome(source), GrabStatus::Lost);
}

TEST(ReopeningSource, GivesUpWhatStaysAway) {
  Plug plug{{{{.stamp_ns = 1}, kLost}, {}}};
  EventRing events;
  ReopeningSource source(plug.factory(), {.stall_s = 1, .give_up_s = 0.3}, events);
  ASSERT_TRUE(source.open().ok());
  ASSERT_TRUE(source.start().ok());
  EXPECT_EQ(next_outcome(source), GrabStatus::Frame);
  EXPECT_EQ(next_outcome(source), GrabStatus::Lost);
  EXPECT_GE(plug.opened, 2u);
  EXPECT_THAT(codes(events), testing::ElementsAre(EventCode::SourceGone));
}

TEST(ReopeningSource, ARunGoesOnAfterAnInterruptionAndEndsWhenTheCameraIsGoneForGood) {
  std::vector<Grab> before, after;
  for (int i = 0; i < 12; ++i) {
    const Grab frame{.stamp_ns = test::WallScene::stamp_ns(i), .picture = i, .takes_ns = 20'000'000};
    (i < 6 ? before : after).push_back(frame);
  }
  before.push_back(kLost);
  after.push_back({.status = GrabStatus::Dropped, .reason = DropReason::CorruptDepth});
  after.push_back({.stamp_ns = test::WallScene::stamp_ns(3), .picture = 3});  // its clock jumps back
  after.push_back(kLost);
  static const test::WallScene scene;
  Plug plug{{before, {}, after, {}},
            0,
            {.name = "wall", .width = test::WallScene::kWidth, .height = test::WallScene::kHeight, .fps = 30},
            [](int picture, FrameSlot& slot) { scene.draw(picture, slot); }};
  EventRing events;
  ReopeningSource source(plug.factory(), {.stall_s = 1, .give_up_s = 1}, events);
  ASSERT_TRUE(source.open().ok());
  ASSERT_TRUE(source.start().ok());
  RunOptions options;
  options.mode = RunMode::Live;
  test::Pipeline p(source, options);
  run_threads(*p.context);
  p.expect_accounted();
  EXPECT_EQ(p.context->counters.offered.load(), 14u);
  EXPECT_EQ(p.dropped(DropReason::CorruptDepth), 1u);
  EXPECT_EQ(p.dropped(DropReason::TimeJump), 1u);
  EXPECT_TRUE(p.context->source_lost);
  EXPECT_EQ(run_outcome(*p.context).error().exit_code, ExitCode::RunFailed);
}

}  // namespace
}  // namespace stillmap
