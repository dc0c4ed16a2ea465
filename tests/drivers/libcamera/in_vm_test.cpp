// SPDX-License-Identifier: Apache-2.0
// Runs where run_in_vm.py --vimc starts it: libcamera's camera is the kernel's virtual media device (vimc),
// and the first video node is a virtual camera (vivid) that stands in for depth.
#include <dlfcn.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "drivers/camera_module.h"
#include "drivers/paired/paired.h"
#include "drivers/v4l2/v4l2_stream.h"
#include "tests/drivers/v4l2/program_run.h"
#include "tests/support/frame.h"
#include "tests/support/heap_calls.h"

namespace stillmap {
namespace {

using testing::Contains;
using testing::Field;
using testing::HasSubstr;

// vimc's scaler makes sizes that can be divided by 6, and vivid has none of those.
constexpr int kWidth = 318, kHeight = 180, kDepthWidth = 320;
constexpr const char* kCamera = "platform/vimc.0 Sensor B";
constexpr const char* kDepth = "/dev/video0";

CameraModule& module() {
  static void* library = dlopen("/bin/libstillmap_driver_libcamera.so", RTLD_NOW | RTLD_LOCAL);
  EXPECT_NE(library, nullptr) << dlerror();
  return *reinterpret_cast<CameraModuleEntry>(dlsym(library, kCameraModuleEntry))();
}

CameraRequest request() {
  return {.device = kCamera, .width = kWidth, .height = kHeight, .fps = 10};
}

Nanoseconds soon() {
  return monotonic_now() + 5'000'000'000;
}

/// A stream that has been opened and started.
std::unique_ptr<PictureStream> running() {
  auto stream = module().make(request()).colour;
  const Status opened = stream->open();
  EXPECT_TRUE(opened.ok()) << opened.error().message;
  EXPECT_TRUE(stream->start().ok());
  return stream;
}

std::uint64_t checksum(const HeldPicture& held) {
  const RawPicture::Plane& plane = held.picture.planes[0];
  std::uint64_t sum = 14695981039346656037U;
  for (std::size_t i = 0; i < plane.bytes; ++i)
    sum = (sum ^ static_cast<std::uint64_t>(plane.data[i])) * 1099511628211U;
  return sum;
}

TEST(Libcamera, ListsCameras) {
  EXPECT_THAT(module().list(), Contains(Field(&FoundCamera::device, kCamera)));
}

TEST(Libcamera, PicturesComeInMappedBuffersWithTheKernelsStamps) {
  auto stream = running();
  ColourConverter converter(stream->describe().format, kWidth, kHeight);
  std::vector<Bgr> pixels(kWidth * kHeight);
  const ImageView<Bgr> view{pixels.data(), kWidth, kHeight, kWidth};
  std::set<const std::byte*> places;
  HeldPicture held;
  Nanoseconds newest_ns = 0;
  long heap = 0;
  constexpr int kPictures = 20;
  for (int i = 0; i < kPictures; ++i) {
    const long before = test::heap_calls();
    ASSERT_EQ(stream->peek(held, soon()), PeekStatus::Picture);
    ASSERT_EQ(converter.convert(held.picture, view), DecodeStatus::Ok);
    stream->release();
    heap += test::heap_calls() - before;
    EXPECT_GT(held.stamp_ns, newest_ns);
    EXPECT_LE(held.stamp_ns, monotonic_now());
    EXPECT_GT(held.stamp_ns, monotonic_now() - 2'000'000'000);
    newest_ns = held.stamp_ns;
    places.insert(held.picture.planes[0].data);
  }
  EXPECT_LE(places.size(), 4u) << "each buffer is mapped once";
  EXPECT_GT(places.size(), 1u);
  // White, yellow, cyan, green, magenta, red, blue, black.
  const auto bar = [&](int n) { return view.at(n * kWidth / 8 + kWidth / 16, kHeight - 20); };
  for (int n = 0; n < 8; ++n) {
    EXPECT_EQ(bar(n).g > 96, n < 4) << n;
    EXPECT_EQ(bar(n).r > 96, n % 4 < 2) << n;
    EXPECT_EQ(bar(n).b > 96, n % 2 == 0) << n;
  }
  EXPECT_EQ(heap, 0) << "what libcamera takes to queue a buffer, it takes on its own thread";
}

TEST(Libcamera, AHeldPictureStaysAsItIsAndThenTheStreamGoesOn) {
  auto stream = running();
  HeldPicture held, again;
  for (int i = 0; i < 3; ++i) {
    ASSERT_EQ(stream->peek(held, soon()), PeekStatus::Picture);
    stream->release();
  }
  ASSERT_EQ(stream->peek(held, soon()), PeekStatus::Picture);
  const std::uint64_t before = checksum(held);
  usleep(1'500'000);  // every other buffer is filled meanwhile
  ASSERT_EQ(stream->peek(again, 0), PeekStatus::Picture);
  EXPECT_EQ(again.picture.planes[0].data, held.picture.planes[0].data);
  EXPECT_EQ(again.stamp_ns, held.stamp_ns);
  EXPECT_EQ(checksum(again), before);
  stream->release();
  for (int i = 0; i < 8; ++i) {
    ASSERT_EQ(stream->peek(again, soon()), PeekStatus::Picture) << i;
    stream->release();
  }
  EXPECT_GT(again.stamp_ns, held.stamp_ns);
}

TEST(Libcamera, NothingArrivesBeforeTheDeadlineAndItStartsAgain) {
  auto stream = running();
  HeldPicture held;
  ASSERT_EQ(stream->peek(held, soon()), PeekStatus::Picture);
  stream->stop();
  EXPECT_EQ(stream->peek(held, monotonic_now() + 200'000'000), PeekStatus::Timeout);
  ASSERT_TRUE(stream->start().ok());
  EXPECT_EQ(stream->peek(held, soon()), PeekStatus::Picture);
  EXPECT_EQ(held.missed, 0u);
}

TEST(Libcamera, RefusalsNameTheCameraAndTheMend) {
  const auto refusal = [](const CameraRequest& wanted) {
    const Status opened = module().make(wanted).colour->open();
    return opened.ok() ? "" : opened.error().message;
  };
  CameraRequest wanted = request();
  wanted.device = "no-such-camera";
  EXPECT_THAT(refusal(wanted), HasSubstr("libcamera:no-such-camera: no such camera; `stillmap devices`"));
  wanted = request();
  wanted.colour_format = "MJPG";
  EXPECT_THAT(refusal(wanted), HasSubstr("no colour of 318x180 px in a format that can be read as MJPG"));
  wanted = request();
  wanted.width = 8001;
  EXPECT_THAT(refusal(wanted), testing::AllOf(HasSubstr("no colour of 8001x180 px"), HasSubstr("nearest: ")));
  auto first = running();
  EXPECT_THAT(refusal(request()), HasSubstr("another program uses it"));
  EXPECT_FALSE(module().lens(request()).has_value());
}

TEST(Libcamera, WithADepthNodeItMakesFrames) {
  Paired::Setup setup;
  setup.name = "libcamera";
  setup.fps = 10;
  setup.colour.width = kWidth, setup.colour.height = kHeight;
  setup.colour.fx = setup.colour.fy = 300, setup.colour.cx = 160, setup.colour.cy = 90;
  setup.depth_lens = setup.colour;
  setup.depth_lens->width = kDepthWidth;
  Paired driver(setup, module().make(request()).colour,
                std::make_unique<V4l2Stream>(V4l2Request{.device = kDepth,
                                                         .depth = true,
                                                         .width = kDepthWidth,
                                                         .height = kHeight,
                                                         .fps = 10,
                                                         .format = "",
                                                         .controls = {}}));
  const Status opened = driver.open();
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  ASSERT_TRUE(driver.start().ok());
  test::Frame slot(kWidth, kHeight);
  int frames = 0;
  for (int i = 0; i < 100 && frames < 5; ++i) {
    const GrabResult grabbed = driver.grab(slot, soon());
    ASSERT_TRUE(grabbed.status == GrabStatus::Frame || grabbed.status == GrabStatus::Dropped);
    if (grabbed.status != GrabStatus::Frame) continue;
    ++frames;
    EXPECT_LE(std::abs(slot.colour_ns - slot.depth_ns), 50'000'000);
    EXPECT_GT(slot.depth.at(20, 160), 0);
  }
  EXPECT_EQ(frames, 5);
  driver.stop();
}

TEST(LibcameraProgram, RunsAndEndsOnSigterm) {
  for (const std::string& source :
       {std::string("libcamera:") + kCamera + "," + kDepth, std::string("libcamera:") + kCamera}) {
    test::ProgramRun run(
        source, {"camera.width=318", "camera.height=180", "camera.fx=300", "camera.fy=300", "camera.cx=160",
                 "camera.cy=90", "camera.fps=10", "camera.depth_units_per_m=20000", "camera.depth_min_m=0.1",
                 "camera.depth.width=320", "camera.depth.height=180", "camera.depth.fx=300",
                 "camera.depth.fy=300", "camera.depth.cx=160", "camera.depth.cy=90",
                 "camera.depth.T_colour_depth=[0,0,0,0,0,0,1]", "map.capacity_voxels=100000"});
    EXPECT_TRUE(run.says("tracking_started")) << run.said();
    EXPECT_EQ(run.end(SIGTERM), 0) << run.said();
    const nlohmann::json facts = test::report();
    const nlohmann::json& frames = facts["frames"];
    EXPECT_GT(frames["processed"], 0);
    EXPECT_EQ(frames["offered"], frames["processed"].get<std::uint64_t>() + test::sum(frames["dropped"]));
    EXPECT_EQ(facts["source"], source);
    EXPECT_GE(facts["capture"]["stamp_to_slot_ms"]["p50"], 0);
    EXPECT_EQ(facts["memory"]["heap_allocations_after_start"]["capture"], 0);
    EXPECT_GT(facts["memory"]["heap_allocations_after_start"]["driver"], 0) << "the library's own thread";
    std::printf("%s capture %s heap %s\n", frames.dump().c_str(), facts["capture"].dump().c_str(),
                facts["memory"]["heap_allocations_after_start"].dump().c_str());
  }
}

TEST(LibcameraProgram, DevicesListsItWithItsPartner) {
  EXPECT_THAT(test::output("/bin/stillmap devices"),
              HasSubstr(std::string("libcamera:") + kCamera + "," + kDepth));
}

}  // namespace
}  // namespace stillmap
