// SPDX-License-Identifier: Apache-2.0
#include "runtime/reopening_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/runtime/running.h"

namespace stillmap {
namespace {

using Grab = test::ScriptedDriver::Grab;

/// What the cameras do that are opened one after another; the last one for ever.
struct Plug {
  std::vector<std::vector<Grab>> cameras;  ///< none: this one does not open
  std::size_t opened = 0;
  SourceInfo info{.name = "camera", .width = 4, .height = 4, .fps = 30};
  test::ScriptedDriver::Fill fill = [](int, FrameSlot&) {};
  std::vector<std::string> reasons{};  ///< why the n-th does not open, where it does not
  std::vector<std::size_t> gone_when_started{};

  class Camera : public test::ScriptedDriver {
   public:
    Camera(const Plug& plug, std::vector<Grab> grabs)
        : ScriptedDriver(plug.info, grabs, plug.fill),
          absent_(grabs.empty()),
          starts_(std::ranges::count(plug.gone_when_started, plug.opened) == 0),
          reason_(plug.opened < plug.reasons.size() ? plug.reasons[plug.opened] : "no such camera") {}
    Status open() override {
      if (absent_) return Error{ExitCode::RunFailed, reason_};
      return {};
    }
    Status start() override {
      if (!starts_) return Error{ExitCode::RunFailed, "gone when it was to start"};
      return {};
    }

   private:
    bool absent_, starts_;
    std::string reason_;
  };
  ReopeningSource::Factory factory() {
    return [this] {
      auto camera = std::make_unique<Camera>(*this, cameras[std::min(opened, cameras.size() - 1)]);
      ++opened;
      return camera;
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

/// Opened and started.
struct Opened {
  Opened(Plug& plug, ReopeningSource::Patience patience) : source(plug.factory(), patience, news) {
    EXPECT_TRUE(source.open().ok());
    EXPECT_TRUE(source.start().ok());
  }
  /// Grabs until a frame or the end, at most for five seconds.
  GrabStatus next() {
    FrameSlot slot;
    const Nanoseconds end = monotonic_now() + 5'000'000'000;
    while (monotonic_now() < end) {
      const GrabResult r = source.grab(slot, monotonic_now() + 20'000'000);
      if (r.status != GrabStatus::Timeout) return r.status;
    }
    return GrabStatus::Timeout;
  }
  std::vector<EventCode> told() { return codes(news.events); }
  std::string refusal() {
    news.refusal.refresh();
    return news.refusal.value().data();
  }
  SourceNews news;
  ReopeningSource source;
};

/// Cameras that show the wall scene.
Plug wall_plug(std::vector<std::vector<Grab>> cameras) {
  static const test::WallScene scene;
  return {std::move(cameras),
          0,
          {.name = "wall", .width = test::WallScene::kWidth, .height = test::WallScene::kHeight, .fps = 30},
          [](int picture, FrameSlot& slot) { scene.draw(picture, slot); }};
}

TEST(ReopeningSource, OpensAnUnpluggedCameraAgain) {
  Plug plug{{{{.stamp_ns = 1}, kLost}, {}, {{.stamp_ns = 2}, kLost}, {{.stamp_ns = 3}}}};
  Opened camera(plug, {.stall_s = 1, .give_up_s = 30});
  EXPECT_EQ(camera.source.describe().name, "camera");
  EXPECT_EQ(camera.next(), GrabStatus::Frame);
  EXPECT_EQ(camera.next(), GrabStatus::Frame) << "the second did not open, the third did";
  EXPECT_EQ(camera.next(), GrabStatus::Frame);
  EXPECT_EQ(plug.opened, 4u);
  EXPECT_THAT(camera.told(),
              testing::ElementsAre(EventCode::SourceGone, EventCode::SourceRefused, EventCode::SourceBack,
                                   EventCode::SourceGone, EventCode::SourceBack));
}

TEST(ReopeningSource, UnpluggedBeforeItRunsItIsRefused) {
  SourceNews news;
  Plug absent{{{}}};
  absent.reasons = {"/dev/video0: no such camera"};
  ReopeningSource unopened(absent.factory(), {.stall_s = 1, .give_up_s = 30}, news);
  EXPECT_EQ(unopened.open().error().message, "/dev/video0: no such camera");
  Plug leaving{{{{.stamp_ns = 1}}}};
  leaving.gone_when_started = {0};
  ReopeningSource unstarted(leaving.factory(), {.stall_s = 1, .give_up_s = 30}, news);
  ASSERT_TRUE(unstarted.open().ok());
  EXPECT_EQ(unstarted.start().error().message, "gone when it was to start");
  EXPECT_TRUE(codes(news.events).empty());
}

TEST(ReopeningSource, UnpluggedInAnyPhaseOfComingBackItIsOpenedAgain) {
  // Before its first picture; having come back, before it is started; and before its first picture then.
  Plug plug{{{kLost}, {{.stamp_ns = 1}}, {kLost}, {{.stamp_ns = 2}}}};
  plug.gone_when_started = {1};
  Opened camera(plug, {.stall_s = 1, .give_up_s = 30});
  EXPECT_EQ(camera.next(), GrabStatus::Frame);
  EXPECT_EQ(plug.opened, 4u);
  EXPECT_THAT(camera.told(), testing::ElementsAre(EventCode::SourceGone, EventCode::SourceRefused,
                                                  EventCode::SourceRefused, EventCode::SourceBack));
}

TEST(ReopeningSource, ARunStopsWhileItsCameraIsAway) {
  Plug plug = wall_plug({{{.stamp_ns = test::WallScene::stamp_ns(0)}, kLost}, {}});
  Opened camera(plug, {.stall_s = 1, .give_up_s = 3600});
  RunOptions options;
  options.mode = RunMode::Live;
  test::Pipeline p(camera.source, options);
  test::Running running(p);
  running.wait_for_frames(1);
  test::wait_until([&] { return camera.told().size() > 0; });
  EXPECT_LT(running.stop_s(), test::kStopDeadline_s);
  p.expect_accounted();
  EXPECT_FALSE(p.context->source_lost);
}

TEST(ReopeningSource, OpensASilentCameraAgain) {
  Plug plug{{{{.stamp_ns = 1}, kSilent, kSilent, kSilent, kSilent, kSilent, kSilent, kSilent, kSilent},
             {{.stamp_ns = 2}}}};
  Opened camera(plug, {.stall_s = 0.1, .give_up_s = 30});
  EXPECT_EQ(camera.next(), GrabStatus::Frame);
  EXPECT_EQ(camera.next(), GrabStatus::Frame);
  EXPECT_THAT(camera.told(), testing::ElementsAre(EventCode::SourceStalled, EventCode::SourceBack));
}

TEST(ReopeningSource, ACameraOfAnotherSizeIsNotTakenForIt) {
  Plug plug{{{{.stamp_ns = 1}, kLost}, {{.stamp_ns = 2}}}};
  Opened camera(plug, {.stall_s = 1, .give_up_s = 0.4});
  EXPECT_EQ(camera.next(), GrabStatus::Frame);
  plug.info.width = 8;
  EXPECT_EQ(camera.next(), GrabStatus::Lost);
  EXPECT_THAT(camera.refusal(), testing::HasSubstr("camera: came back with pictures of another size"));
}

TEST(ReopeningSource, GivesUpWhatStaysAway) {
  Plug plug{{{{.stamp_ns = 1}, kLost}, {}}};
  Opened camera(plug, {.stall_s = 1, .give_up_s = 1});
  EXPECT_EQ(camera.next(), GrabStatus::Frame);
  EXPECT_EQ(camera.next(), GrabStatus::Lost);
  EXPECT_GE(plug.opened, 2u);
  EXPECT_THAT(camera.told(), testing::ElementsAre(EventCode::SourceGone, EventCode::SourceRefused))
      << "each reason once, however often it is tried";
  EXPECT_EQ(camera.refusal(), "no such camera");
}

TEST(ReopeningSource, GivesUpWhatCanBeOpenedButDeliversNothing) {
  std::vector<Grab> silent(2000, kSilent);
  Plug plug{{{{.stamp_ns = 1}, kLost}, silent}};
  Opened camera(plug, {.stall_s = 0.05, .give_up_s = 0.6});
  EXPECT_EQ(camera.next(), GrabStatus::Frame);
  EXPECT_EQ(camera.next(), GrabStatus::Lost);
  EXPECT_GE(plug.opened, 3u);
  EXPECT_THAT(camera.told(), testing::ElementsAre(EventCode::SourceGone, EventCode::SourceRefused))
      << "it was never back";
  EXPECT_THAT(camera.refusal(), testing::HasSubstr("camera: can be opened, but delivers nothing"));
}

TEST(ReopeningSource, EachNewReasonWhyItCannotBeOpenedIsTold) {
  Plug plug{{{{.stamp_ns = 1}, kLost}, {}, {}, {{.stamp_ns = 2}}}};
  plug.reasons = {"", "/dev/video0: no such camera", "/dev/video0: another program uses it"};
  Opened camera(plug, {.stall_s = 1, .give_up_s = 30});
  EXPECT_EQ(camera.next(), GrabStatus::Frame);
  EXPECT_EQ(camera.next(), GrabStatus::Frame);
  EXPECT_THAT(camera.told(), testing::ElementsAre(EventCode::SourceGone, EventCode::SourceRefused,
                                                  EventCode::SourceRefused, EventCode::SourceBack));
  EXPECT_EQ(camera.refusal(), "/dev/video0: another program uses it");
}

TEST(ReopeningSource, TheTrackerThatLostItsWayMeanwhileFindsItAgain) {
  constexpr int kDark = -1;
  std::vector<Grab> before, after;
  const auto frame = [](int i, int picture) {
    return Grab{.stamp_ns = test::WallScene::stamp_ns(i), .picture = picture};
  };
  for (int i = 0; i < 20; ++i) before.push_back(frame(i, i));
  before.push_back(kLost);
  for (int i = 50; i < 56; ++i) after.push_back(frame(i, kDark));  // it comes back with a hand before it
  for (int i = 56; i < 80; ++i) after.push_back(frame(i, i - 50));
  Plug plug = wall_plug({before, {}, after});
  plug.fill = [draw = plug.fill](int picture, FrameSlot& slot) {
    if (picture != kDark) return draw(picture, slot);
    for (int y = 0; y < slot.colour.height; ++y) {
      std::fill_n(slot.colour.row(y), slot.colour.width, Bgr{});
      std::fill_n(slot.depth.row(y), slot.depth.width, std::uint16_t{0});
    }
  };
  Opened camera(plug, {.stall_s = 1, .give_up_s = 30});
  RunOptions options;
  options.mode = RunMode::Lockstep;
  test::Pipeline p(camera.source, options);
  run_lockstep(*p.context);
  p.expect_accounted();
  const RunCounters& c = p.context->counters;
  EXPECT_EQ(c.processed.load(), 50u);
  EXPECT_GE(c.lost.load(), 6u);
  EXPECT_EQ(c.relocalized.load(), 1u);
  EXPECT_EQ(static_cast<TrackState>(c.state.load()), TrackState::Tracking);
  // At the place of the wall that it left, not in a map of its own.
  const auto& poses = p.context->track_log.causal;
  ASSERT_GE(poses.size(), 2u);
  EXPECT_NEAR(norm(poses[poses.size() - 1].T_world_camera.t - poses[0].T_world_camera.t),
              norm(test::WallScene::T_first_camera(29).t), 0.03);
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
  Plug plug = wall_plug({before, after, {}});
  Opened camera(plug, {.stall_s = 1, .give_up_s = 1});
  RunOptions options;
  options.mode = RunMode::Live;
  test::Pipeline p(camera.source, options);
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
