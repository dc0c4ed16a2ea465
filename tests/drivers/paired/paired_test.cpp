// SPDX-License-Identifier: Apache-2.0
#include "drivers/paired/paired.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "tests/support/frame.h"
#include "tests/support/heap_calls.h"

namespace stillmap {
namespace {

using testing::ElementsAre;

constexpr int kWidth = 4, kHeight = 2;
constexpr Nanoseconds kMs = 1'000'000;

/// A stream that shows what a test wrote down. Each picture's pixels hold its number.
class ScriptedStream : public PictureStream {
 public:
  struct Item {
    Nanoseconds stamp_ns = 0;
    PeekStatus status = PeekStatus::Picture;
    std::uint32_t missed = 0;
    bool cut = false;
  };
  ScriptedStream(PixelFormat format, std::vector<Item> items) : items_(std::move(items)) {
    info_ = {.name = "scripted", .format = format, .width = kWidth, .height = kHeight, .fps = 0};
  }
  Status open() override { return opened; }
  StreamInfo describe() const override { return info_; }
  Status start() override { return {}; }
  PeekStatus peek(HeldPicture& out, Nanoseconds) override {
    if (next_ == items_.size()) return PeekStatus::EndOfStream;
    const Item& item = items_[next_];
    if (item.status != PeekStatus::Picture) {
      ++next_;
      return item.status;
    }
    bytes_.fill(static_cast<std::byte>(next_ + 1));
    const std::size_t stride = row_bytes(info_.format, info_.width);
    const std::size_t bytes = picture_bytes(info_.format, info_.height, stride) - (item.cut ? 1 : 0);
    out = {{info_.format, info_.width, info_.height, {{{bytes_.data(), bytes, stride}}}},
           item.stamp_ns,
           item.missed};
    return PeekStatus::Picture;
  }
  void release() override { ++next_; }
  void stop() override {}

  StreamInfo info_;
  Status opened;

 private:
  std::vector<Item> items_;
  std::array<std::byte, 1024> bytes_{};
  std::size_t next_ = 0;
};

Paired::Setup setup() {
  Paired::Setup s;
  s.name = "pair";
  s.colour.width = kWidth, s.colour.height = kHeight;
  s.colour.fx = s.colour.fy = 4;
  s.colour.cx = 2, s.colour.cy = 1;
  s.fps = 25;  // half a frame is 20 ms
  return s;
}

/// Plays both to the end: "COLOUR+DEPTH" by their numbers, or the reason.
std::vector<std::string> play(std::vector<ScriptedStream::Item> colour,
                              std::vector<ScriptedStream::Item> depth) {
  Paired driver(setup(), std::make_unique<ScriptedStream>(PixelFormat::Grey, std::move(colour)),
                std::make_unique<ScriptedStream>(PixelFormat::Depth16, std::move(depth)));
  EXPECT_TRUE(driver.open().ok());
  EXPECT_TRUE(driver.start().ok());
  std::vector<std::string> story;
  test::Frame slot(kWidth, kHeight);
  for (;;) {
    const long before = test::heap_calls();
    const GrabResult r = driver.grab(slot, 0);
    EXPECT_EQ(test::heap_calls(), before);
    switch (r.status) {
      case GrabStatus::EndOfStream:
        return story;
      case GrabStatus::Frame:
        story.push_back(std::to_string(slot.colour.at(3, 1).g) + "+" +
                        std::to_string(slot.depth.at(3, 1) & 255));
        break;
      case GrabStatus::Dropped:
        story.emplace_back(to_string(r.reason));
        break;
      case GrabStatus::Timeout:
        story.emplace_back("timeout");
        break;
      case GrabStatus::Lost:
        story.emplace_back("lost");
        return story;
    }
  }
}

TEST(Paired, PicturesWithinHalfAFrameMakeAFrame) {
  EXPECT_THAT(play({{100 * kMs}, {140 * kMs}, {180 * kMs}}, {{120 * kMs}, {121 * kMs}, {161 * kMs}}),
              ElementsAre("1+1", "2+2", "3+3"))
      << "20 ms apart still is a pair";
  EXPECT_THAT(play({{100 * kMs}, {140 * kMs}}, {{79 * kMs}, {121 * kMs}, {145 * kMs}}),
              ElementsAre("no_depth_match", "2+2"))
      << "depth before and after the first by 21 ms; the first depth that fits the second makes the frame";
}

TEST(Paired, KeepsBothStamps) {
  Paired driver(
      setup(),
      std::make_unique<ScriptedStream>(PixelFormat::Grey, std::vector<ScriptedStream::Item>{{500 * kMs}}),
      std::make_unique<ScriptedStream>(PixelFormat::Depth16, std::vector<ScriptedStream::Item>{{507 * kMs}}));
  ASSERT_TRUE(driver.open().ok());
  ASSERT_TRUE(driver.start().ok());
  test::Frame slot(kWidth, kHeight);
  ASSERT_EQ(driver.grab(slot, 0).status, GrabStatus::Frame);
  EXPECT_EQ(slot.colour_ns, 500 * kMs);
  EXPECT_EQ(slot.depth_ns, 507 * kMs);
  EXPECT_EQ(driver.describe().fps, 25);
}

TEST(Paired, TooMuchOfEitherIsLeftOut) {
  EXPECT_THAT(
      play({{100 * kMs}, {200 * kMs}}, {{60 * kMs}, {100 * kMs}, {140 * kMs}, {180 * kMs}, {220 * kMs}}),
      ElementsAre("1+2", "2+4"));
  EXPECT_THAT(play({{100 * kMs}, {140 * kMs}, {180 * kMs}}, {{100 * kMs}, {180 * kMs}}),
              ElementsAre("1+1", "no_depth_match", "3+2"));
}

TEST(Paired, WhatTheDeviceLostIsCountedOneByOne) {
  using Item = ScriptedStream::Item;
  EXPECT_THAT(play({{100 * kMs}, Item{.stamp_ns = 220 * kMs, .missed = 2}}, {{100 * kMs}, {220 * kMs}}),
              ElementsAre("1+1", "driver_dropped", "driver_dropped", "2+2"));
  EXPECT_THAT(
      play({{100 * kMs}, {140 * kMs}, {180 * kMs}}, {{100 * kMs}, Item{.stamp_ns = 180 * kMs, .missed = 1}}),
      ElementsAre("1+1", "driver_dropped", "3+2"))
      << "the reason is the lost depth, not a bad match";
}

TEST(Paired, DamageHasItsReason) {
  using Item = ScriptedStream::Item;
  const Item corrupt{.status = PeekStatus::Corrupt};
  EXPECT_THAT(play({{100 * kMs}, corrupt, {180 * kMs}}, {{100 * kMs}, {140 * kMs}, {180 * kMs}}),
              ElementsAre("1+1", "corrupt_colour", "3+3"));
  EXPECT_THAT(play({{100 * kMs}, {140 * kMs}, {180 * kMs}}, {{100 * kMs}, corrupt, {180 * kMs}}),
              ElementsAre("1+1", "corrupt_depth", "3+3"));
  EXPECT_THAT(play({{100 * kMs}, {140 * kMs}, {180 * kMs}, {220 * kMs}},
                   {{100 * kMs}, corrupt, {180 * kMs}, {300 * kMs}}),
              ElementsAre("1+1", "corrupt_depth", "3+3", "no_depth_match"))
      << "a frame later, the damage is no reason any more";
  EXPECT_THAT(play({Item{.stamp_ns = 100 * kMs, .cut = true}, {140 * kMs}}, {{100 * kMs}, {140 * kMs}}),
              ElementsAre("corrupt_colour", "2+2"));
  EXPECT_THAT(play({{100 * kMs}, {140 * kMs}}, {Item{.stamp_ns = 100 * kMs, .cut = true}, {140 * kMs}}),
              ElementsAre("corrupt_depth", "2+2"));
}

TEST(Paired, WaitsAndLossesOfEitherArePassedOn) {
  using Item = ScriptedStream::Item;
  EXPECT_THAT(play({Item{.status = PeekStatus::Timeout}, {100 * kMs}},
                   {Item{.status = PeekStatus::Timeout}, {100 * kMs}}),
              ElementsAre("timeout", "timeout", "2+2"))
      << "the colour picture waits for its depth";
  EXPECT_THAT(play({{100 * kMs}}, {Item{.status = PeekStatus::Lost}}), ElementsAre("lost"));
  EXPECT_THAT(play({Item{.status = PeekStatus::Lost}}, {{100 * kMs}}), ElementsAre("lost"));
}

TEST(Paired, RegistersDepthOfAnotherCamera) {
  Paired::Setup s = setup();
  s.depth_lens = s.colour;
  s.colour.depth_units_per_m = 257;               // each reading is 0x0101: one metre
  s.T_colour_depth = Pose{Mat3{}, {0.25, 0, 0}};  // 4 px * 0.25 m / 1 m: one pixel to the right
  Paired driver(
      s, std::make_unique<ScriptedStream>(PixelFormat::Grey, std::vector<ScriptedStream::Item>{{100 * kMs}}),
      std::make_unique<ScriptedStream>(PixelFormat::Depth16, std::vector<ScriptedStream::Item>{{100 * kMs}}));
  ASSERT_TRUE(driver.open().ok());
  ASSERT_TRUE(driver.start().ok());
  test::Frame slot(kWidth, kHeight);
  ASSERT_EQ(driver.grab(slot, 0).status, GrabStatus::Frame);
  EXPECT_THAT(slot.depth_pixels, ElementsAre(0, 257, 257, 257, 0, 257, 257, 257));
}

TEST(Paired, RefusesStreamsThatDoNotFitTheProfile) {
  const auto open = [](int colour_width, int depth_width) {
    auto colour = std::make_unique<ScriptedStream>(PixelFormat::Grey, std::vector<ScriptedStream::Item>{});
    auto depth = std::make_unique<ScriptedStream>(PixelFormat::Depth16, std::vector<ScriptedStream::Item>{});
    colour->info_.width = colour_width;
    depth->info_.width = depth_width;
    const Status s = Paired(setup(), std::move(colour), std::move(depth)).open();
    return s.ok() ? "" : s.error().message;
  };
  EXPECT_EQ(open(4, 4), "");
  EXPECT_THAT(open(6, 4), testing::HasSubstr("delivers 6x2 px, camera.width and camera.height say 4x2"));
  EXPECT_THAT(open(4, 6), testing::HasSubstr("camera.depth.T_colour_depth"));
}

}  // namespace
}  // namespace stillmap
