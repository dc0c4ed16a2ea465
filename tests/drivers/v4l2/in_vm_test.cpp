// SPDX-License-Identifier: Apache-2.0
// Runs where run_in_vm.py starts it: /dev/video0 and 1 are the kernel's virtual cameras (vivid) with one
// plane a buffer, /dev/video2 has several. They show eight colour bars, and do damage when asked by a
// control.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdio>
#include <ctime>
#include <vector>

#include "drivers/paired/paired.h"
#include "drivers/v4l2/v4l2_stream.h"
#include "tests/support/heap_calls.h"

namespace stillmap {
namespace {

using testing::HasSubstr;

// Small and slow, since an emulated processor has to paint the bars and to convert them.
constexpr int kWidth = 320, kHeight = 180;
constexpr double kFps = 10;
constexpr std::uint32_t kLosePercent = 0x00f0f040, kDisconnect = 0x00f0f041, kMarkDamaged = 0x00f0f042;

V4l2Request request(const std::string& device, const std::string& format, bool depth = false) {
  return {.device = device,
          .depth = depth,
          .width = kWidth,
          .height = kHeight,
          .fps = kFps,
          .format = format,
          .controls = {}};
}

void set_control(const std::string& device, std::uint32_t id, int value) {
  const int file = open(device.c_str(), O_RDWR);
  v4l2_control control{id, value};
  ASSERT_EQ(ioctl(file, VIDIOC_S_CTRL, &control), 0) << id;
  close(file);
}

int get_control(const std::string& device, std::uint32_t id) {
  const int file = open(device.c_str(), O_RDWR);
  v4l2_control control{id, 0};
  EXPECT_EQ(ioctl(file, VIDIOC_G_CTRL, &control), 0);
  close(file);
  return control.value;
}

/// For a processor that is emulated on a busy machine.
Nanoseconds soon() {
  return monotonic_now() + 30'000'000'000;
}

struct Picture {
  std::vector<Bgr> pixels = std::vector<Bgr>(kWidth * kHeight);
  ImageView<Bgr> view{pixels.data(), kWidth, kHeight, kWidth};
  Bgr bar(int i) const { return view.at(i * kWidth / 8 + kWidth / 16, kHeight - 20); }
};

Picture first_picture(const V4l2Request& wanted) {
  Picture picture;
  V4l2Stream stream(wanted);
  const Status opened = stream.open();
  EXPECT_TRUE(opened.ok()) << opened.error().message;
  if (!opened.ok()) return picture;
  EXPECT_TRUE(stream.start().ok());
  HeldPicture held;
  EXPECT_EQ(stream.peek(held, soon()), PeekStatus::Picture);
  ColourConverter converter(stream.describe().format, kWidth, kHeight);
  EXPECT_EQ(converter.convert(held.picture, picture.view), DecodeStatus::Ok);
  stream.release();
  return picture;
}

TEST(V4l2, EveryFormatShowsTheSameBars) {
  const Picture rgb = first_picture(request("/dev/video0", "RGB3"));
  // White, yellow, cyan, green, magenta, red, blue, black.
  for (int i = 0; i < 8; ++i) {
    const Bgr bar = rgb.bar(i);
    EXPECT_EQ(bar.g > 96, i < 4) << i;
    EXPECT_EQ(bar.r > 96, i % 4 < 2) << i;
    EXPECT_EQ(bar.b > 96, i % 2 == 0) << i;
  }
  for (const auto& [device, format] : {std::pair("/dev/video0", "YUYV"),
                                       {"/dev/video0", "NV12"},
                                       {"/dev/video0", "BGR3"},
                                       {"/dev/video2", "YUYV"},
                                       {"/dev/video2", "NV12"},
                                       {"/dev/video2", "NM12"}}) {
    const Picture other = first_picture(request(device, format));
    for (int i = 0; i < 8; ++i) {
      EXPECT_NEAR(other.bar(i).b, rgb.bar(i).b, 4) << format << " bar " << i;
      EXPECT_NEAR(other.bar(i).g, rgb.bar(i).g, 4) << format << " bar " << i;
      EXPECT_NEAR(other.bar(i).r, rgb.bar(i).r, 4) << format << " bar " << i;
    }
  }
  const Picture grey = first_picture(request("/dev/video0", "GREY"));
  for (int i = 1; i < 8; ++i) EXPECT_LT(grey.bar(i).g, grey.bar(i - 1).g) << "bars go from white to black";
}

TEST(V4l2, WithoutAWishItTakesTheBestFormat) {
  V4l2Stream colour(request("/dev/video0", "")), depth(request("/dev/video1", "", true));
  ASSERT_TRUE(colour.open().ok());
  ASSERT_TRUE(depth.open().ok());
  EXPECT_EQ(colour.describe().format, PixelFormat::Yuyv);
  EXPECT_EQ(depth.describe().format, PixelFormat::Depth16);
  EXPECT_NEAR(colour.describe().fps, kFps, 0.1);
}

TEST(V4l2, DepthIsReadInPlace) {
  V4l2Stream stream(request("/dev/video1", "Y16", true));
  ASSERT_TRUE(stream.open().ok());
  ASSERT_TRUE(stream.start().ok());
  HeldPicture held;
  ASSERT_EQ(stream.peek(held, soon()), PeekStatus::Picture);
  ImageView<const std::uint16_t> readings;
  ASSERT_EQ(depth_view(held.picture, readings), DecodeStatus::Ok);
  for (int i = 1; i < 8; ++i)
    EXPECT_LT(readings.at(i * 40 + 20, 160), readings.at(i * 40 - 20, 160)) << "bars go from white to black";
  HeldPicture again;
  ASSERT_EQ(stream.peek(again, 0), PeekStatus::Picture);
  EXPECT_EQ(again.picture.planes[0].data, held.picture.planes[0].data) << "until it is released";
}

TEST(V4l2, StampsAreTheKernelsAndNothingIsTakenFromTheHeap) {
  V4l2Stream stream(request("/dev/video0", "YUYV"));
  ASSERT_TRUE(stream.open().ok());
  const Nanoseconds before = monotonic_now();
  ASSERT_TRUE(stream.start().ok());
  ColourConverter converter(PixelFormat::Yuyv, kWidth, kHeight);
  Picture into;
  HeldPicture held;
  Nanoseconds first_ns = 0, newest_ns = 0;
  std::uint32_t missed = 0;
  constexpr int kPictures = 15;
  const long heap_before = test::heap_calls();
  const std::clock_t cpu_before = std::clock();
  for (int i = 0; i < kPictures; ++i) {
    ASSERT_EQ(stream.peek(held, soon()), PeekStatus::Picture);
    ASSERT_EQ(converter.convert(held.picture, into.view), DecodeStatus::Ok);
    const Nanoseconds now = monotonic_now();
    EXPECT_GT(held.stamp_ns, newest_ns);
    EXPECT_LE(held.stamp_ns, now + 100'000'000)
        << "the virtual camera dates a picture to the end of its frame";
    EXPECT_GT(held.stamp_ns, before);
    if (i == 0) first_ns = held.stamp_ns;
    if (i > 0) missed += held.missed;
    newest_ns = held.stamp_ns;
    stream.release();
  }
  EXPECT_EQ(test::heap_calls(), heap_before);
  EXPECT_NEAR(to_seconds(newest_ns - first_ns) * kFps, kPictures - 1 + missed, 1.5);
  std::printf("YUYV 320x180: %.2f ms of CPU a picture\n",
              static_cast<double>(std::clock() - cpu_before) * 1e3 / CLOCKS_PER_SEC / kPictures);
}

TEST(V4l2, LostPicturesAreCounted) {
  V4l2Stream stream(request("/dev/video0", "YUYV"));
  ASSERT_TRUE(stream.open().ok());
  ASSERT_TRUE(stream.start().ok());
  set_control("/dev/video0", kLosePercent, 50);
  HeldPicture held;
  std::uint32_t missed = 0;
  Nanoseconds first_ns = 0, last_ns = 0;
  int pictures = 0;
  for (; pictures < 10 || (missed == 0 && pictures < 200); ++pictures) {  // which are lost, chance decides
    ASSERT_EQ(stream.peek(held, soon()), PeekStatus::Picture);
    if (pictures == 0) first_ns = held.stamp_ns;
    if (pictures > 0) missed += held.missed;
    last_ns = held.stamp_ns;
    stream.release();
  }
  set_control("/dev/video0", kLosePercent, 0);
  EXPECT_GT(missed, 0u);
  EXPECT_NEAR(to_seconds(last_ns - first_ns) * kFps, pictures - 1 + missed, 2) << "the stamps agree";
}

TEST(V4l2, ADamagedPictureIsSaidToBe) {
  V4l2Stream stream(request("/dev/video0", "YUYV"));
  ASSERT_TRUE(stream.open().ok());
  ASSERT_TRUE(stream.start().ok());
  HeldPicture held;
  ASSERT_EQ(stream.peek(held, soon()), PeekStatus::Picture);
  stream.release();
  set_control("/dev/video0", kMarkDamaged, 1);
  int damaged = 0;
  for (int i = 0; i < 10; ++i) {
    const PeekStatus status = stream.peek(held, soon());
    damaged += status == PeekStatus::Corrupt;
    ASSERT_TRUE(status == PeekStatus::Corrupt || status == PeekStatus::Picture);
    stream.release();
  }
  EXPECT_EQ(damaged, 1);
}

TEST(V4l2, UnpluggingIsSeenAtOnceAndItCanBeOpenedAgain) {
  {
    V4l2Stream stream(request("/dev/video0", "YUYV"));
    ASSERT_TRUE(stream.open().ok());
    ASSERT_TRUE(stream.start().ok());
    HeldPicture held;
    ASSERT_EQ(stream.peek(held, soon()), PeekStatus::Picture);
    stream.release();
    set_control("/dev/video0", kDisconnect, 1);
    const Nanoseconds deadline = soon();
    PeekStatus status = PeekStatus::Picture;
    for (int i = 0; i < 8 && status == PeekStatus::Picture; ++i) {
      status = stream.peek(held, deadline);
      stream.release();
    }
    EXPECT_EQ(status, PeekStatus::Lost);
    EXPECT_EQ(stream.peek(held, deadline), PeekStatus::Lost) << "and stays so";
  }
  EXPECT_GT(first_picture(request("/dev/video0", "YUYV")).bar(0).g, 96);
}

TEST(V4l2, NothingArrivesBeforeTheDeadline) {
  V4l2Stream stream(request("/dev/video0", "YUYV"));
  ASSERT_TRUE(stream.open().ok());
  ASSERT_TRUE(stream.start().ok());
  // Between two pictures lie 100 ms; a slow machine needs some tries to look there.
  PeekStatus status = PeekStatus::Picture;
  for (int i = 0; i < 1000 && status == PeekStatus::Picture; ++i) {
    HeldPicture held;
    status = stream.peek(held, monotonic_now());
    stream.release();
  }
  EXPECT_EQ(status, PeekStatus::Timeout);
}

TEST(V4l2, ControlsAreSetByName) {
  V4l2Request wanted = request("/dev/video0", "YUYV");
  wanted.controls = {"brightness=77", "gain_automatic=0"};
  V4l2Stream stream(wanted);
  const Status opened = stream.open();
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  EXPECT_EQ(get_control("/dev/video0", V4L2_CID_BRIGHTNESS), 77);
  EXPECT_EQ(get_control("/dev/video0", V4L2_CID_AUTOGAIN), 0);
}

TEST(V4l2, RefusalsNameTheNodeAndTheMend) {
  const auto refusal = [](V4l2Request wanted) {
    V4l2Stream stream(std::move(wanted));
    const Status opened = stream.open();
    EXPECT_FALSE(opened.ok());
    return opened.ok() ? "" : opened.error().message;
  };
  EXPECT_THAT(refusal(request("/dev/video9", "")), HasSubstr("/dev/video9: no such camera"));
  EXPECT_THAT(refusal(request("/dev/null", "")), HasSubstr("/dev/null: is no video node"));
  EXPECT_THAT(refusal(request("/dev/video0", "MJPG")), HasSubstr("it has the formats "));
  EXPECT_THAT(refusal(request("/dev/video0", "ABCD")),
              HasSubstr("\"ABCD\" is none that can be read as colour"));
  V4l2Request large = request("/dev/video0", "YUYV");
  large.width = 321;
  EXPECT_THAT(refusal(large),
              testing::AllOf(HasSubstr("no colour of 321x180 px"), HasSubstr("nearest: YUYV ")));
  V4l2Request control = request("/dev/video0", "YUYV");
  control.controls = {"sharpnes=3"};
  EXPECT_THAT(refusal(control),
              testing::AllOf(HasSubstr("no control \"sharpnes\""), HasSubstr("brightness")));
  control.controls = {"brightness=300"};
  EXPECT_THAT(refusal(control), HasSubstr("\"brightness=300\" was refused"));
  control.controls = {"brightness=bright"};
  EXPECT_THAT(refusal(control), HasSubstr("not NAME=NUMBER"));
  V4l2Stream first(request("/dev/video0", "YUYV"));
  ASSERT_TRUE(first.open().ok());
  ASSERT_TRUE(first.start().ok());
  EXPECT_THAT(refusal(request("/dev/video0", "YUYV")), HasSubstr("another program uses it"));
}

TEST(V4l2, TwoNodesMakeFrames) {
  Paired::Setup setup;
  setup.name = "v4l2:/dev/video0,/dev/video1";
  setup.colour.width = kWidth, setup.colour.height = kHeight;
  setup.colour.fx = setup.colour.fy = 500, setup.colour.cx = 320, setup.colour.cy = 240;
  Paired driver(setup, std::make_unique<V4l2Stream>(request("/dev/video0", "YUYV")),
                std::make_unique<V4l2Stream>(request("/dev/video1", "Y16 ", true)));
  const Status opened = driver.open();
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  ASSERT_TRUE(driver.start().ok());
  EXPECT_TRUE(driver.describe().monotonic_stamps);
  EXPECT_NEAR(driver.describe().fps, kFps, 0.1);
  Picture colour;
  std::vector<std::uint16_t> depth(kWidth * kHeight);
  FrameSlot slot;
  slot.colour = colour.view;
  slot.depth = {depth.data(), kWidth, kHeight, kWidth};
  int frames = 0;
  const long heap_before = test::heap_calls();
  for (int i = 0; i < 15 || (frames < 8 && i < 500); ++i) {  // an emulated camera may lose some
    const GrabResult grabbed = driver.grab(slot, soon());
    ASSERT_TRUE(grabbed.status == GrabStatus::Frame || grabbed.status == GrabStatus::Dropped);
    if (grabbed.status != GrabStatus::Frame) continue;
    ++frames;
    EXPECT_LE(std::abs(slot.colour_ns - slot.depth_ns), 50'000'000);
    EXPECT_GT(colour.bar(0).g, 96);
    EXPECT_GT(depth[160 * kWidth + 20], 0);
  }
  EXPECT_EQ(test::heap_calls(), heap_before);
  EXPECT_GE(frames, 8);
  set_control("/dev/video1", kDisconnect, 1);
  GrabResult grabbed{GrabStatus::Frame};
  for (int i = 0; i < 8 && grabbed.status != GrabStatus::Lost; ++i) grabbed = driver.grab(slot, soon());
  EXPECT_EQ(grabbed.status, GrabStatus::Lost);
  driver.stop();
}

TEST(V4l2, ListsWhatCanBeCapturedFrom) {
  const std::vector<V4l2Device> devices = list_v4l2_devices();
  ASSERT_EQ(devices.size(), 3u);
  EXPECT_EQ(devices[0].path, "/dev/video0");
  EXPECT_EQ(devices[0].card, "vivid");
  EXPECT_EQ(devices[0].as_colour, 2);
  EXPECT_EQ(devices[0].as_depth, 1) << "it has Y16 but no Z16";
}

TEST(V4l2, DepthIsPairedWithColourOfTheSameDeviceAndNotWithItsInfrared) {
  // A webcam, then a RealSense D435 as uvcvideo shows it: depth, infrared, colour.
  const std::vector<V4l2Device> devices{{"/dev/video0", "webcam", "usb-1", 2, 0},
                                        {"/dev/video2", "D435", "usb-2", 0, 2},
                                        {"/dev/video4", "D435", "usb-2", 1, 1},
                                        {"/dev/video6", "D435", "usb-2", 2, 0}};
  const std::vector<V4l2Pair> pairs = pair_v4l2_devices(devices);
  ASSERT_EQ(pairs.size(), 2u);
  EXPECT_EQ(pairs[0].depth->path, "/dev/video2");
  EXPECT_EQ(pairs[0].colour->path, "/dev/video6");
  EXPECT_EQ(pairs[1].depth->path, "/dev/video4") << "what only may be depth comes last";
  // One without a colour camera goes by its infrared, and two that are plugged in apart go together.
  EXPECT_EQ(pair_v4l2_devices({devices[0], devices[1], devices[2]})[0].colour->bus, "usb-2");
  EXPECT_EQ(pair_v4l2_devices({devices[0], devices[1]})[0].colour->bus, "usb-1");
  EXPECT_TRUE(pair_v4l2_devices({devices[1]}).empty());
}

}  // namespace
}  // namespace stillmap
