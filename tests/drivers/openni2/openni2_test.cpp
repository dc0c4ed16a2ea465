// SPDX-License-Identifier: Apache-2.0
// The module through the real libOpenNI2, with test_device.cpp as its camera.
#include <OpenNI.h>
#include <dlfcn.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <thread>

#include "drivers/camera_module.h"
#include "drivers/paired/paired.h"
#include "drivers/recorder/recorder.h"
#include "tests/drivers/pictures/picture_files.h"
#include "tests/support/frame.h"
#include "tests/support/heap_calls.h"

namespace stillmap {
namespace {

using testing::HasSubstr;

constexpr int kWidth = 64, kHeight = 48, kFrames = 25;
constexpr const char* kCamera = "stillmap-test-camera";

CameraModule& module() {
  static void* library = dlopen(STILLMAP_MODULE, RTLD_NOW | RTLD_LOCAL);
  EXPECT_NE(library, nullptr) << dlerror();
  return *reinterpret_cast<CameraModuleEntry>(dlsym(library, kCameraModuleEntry))();
}

struct Slot : test::Frame {
  Slot() : Frame(kWidth, kHeight) {}
  void draw(int n) {
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        colour.at(x, y) = {static_cast<std::uint8_t>(3 * x), static_cast<std::uint8_t>(10 * n),
                           static_cast<std::uint8_t>(5 * y)};
        depth.at(x, y) = static_cast<std::uint16_t>(500 + 40 * x + 3 * y + n);
      }
    }
    colour_ns = (n + 1) * 33'333'000LL;
    depth_ns = colour_ns + 4'000'000;
  }
  /// Which of the drawn frames this is, by its colour; its depth must be the same one's.
  int number() const {
    const int n = colour.at(7, 5).g / 10;
    EXPECT_EQ(colour.at(7, 5).b, 21);
    EXPECT_EQ(colour.at(7, 5).r, 25);
    EXPECT_EQ(depth.at(7, 5), 500 + 280 + 15 + n);
    EXPECT_EQ(depth.at(kWidth - 1, kHeight - 1), 500 + 40 * 63 + 3 * 47 + n);
    return n;
  }
};

class Openni2 : public testing::Test {
 protected:
  Openni2() {
    Recorder recorder(
        {.folder = log(), .width = kWidth, .height = kHeight, .exact_colour = true, .camera_profile = ""});
    EXPECT_TRUE(recorder.open().ok());
    Slot slot;
    for (int n = 0; n < kFrames; ++n) {
      slot.draw(n);
      EXPECT_TRUE(recorder.write(slot));
    }
    setenv("STILLMAP_TEST_DEVICE_LOG", log().c_str(), 1);
    behave("");
  }
  std::string log() const { return (folder_.path() / "log").string(); }
  static void behave(const char* how) { setenv("STILLMAP_TEST_DEVICE", how, 1); }
  static CameraRequest request(const std::string& device = kCamera) {
    return {.device = device, .width = kWidth, .height = kHeight};
  }
  static std::unique_ptr<Paired> driver(const CameraRequest& wanted) {
    Paired::Setup setup;
    setup.name = "openni2:" + wanted.device;
    setup.colour.width = wanted.width, setup.colour.height = wanted.height;
    setup.colour.fx = setup.colour.fy = 60, setup.colour.cx = 32, setup.colour.cy = 24;
    StreamPair streams = module().make(wanted);
    return std::make_unique<Paired>(setup, std::move(streams.colour), std::move(streams.depth));
  }
  static std::string refusal(const CameraRequest& wanted) {
    const Status s = driver(wanted)->open();
    return s.ok() ? "" : s.error().message;
  }
  static GrabResult grab(Paired& from, Slot& slot, long* heap = nullptr) {
    const long before = test::heap_calls();
    const GrabResult result = from.grab(slot, monotonic_now() + 1'000'000'000);
    if (heap != nullptr) *heap += test::heap_calls() - before;
    return result;
  }
  /// At least so many of the camera's frames are in a recording with both pictures.
  static int pairs_in(const std::string& file) {
    EXPECT_EQ(openni::OpenNI::initialize(), openni::STATUS_OK);
    int pictures = 0;
    {
      openni::Device device;
      EXPECT_EQ(device.open(file.c_str()), openni::STATUS_OK);
      for (const openni::SensorType sensor : {openni::SENSOR_COLOR, openni::SENSOR_DEPTH}) {
        openni::VideoStream stream;
        EXPECT_EQ(stream.create(device, sensor), openni::STATUS_OK);
        pictures += device.getPlaybackControl()->getNumberOfFrames(stream);
        stream.destroy();
      }
      device.close();
    }
    openni::OpenNI::shutdown();
    return pictures - kFrames;
  }
  /// The library itself records what the camera shows. On a busy machine it leaves out pictures: tried until
  /// two frames at least have both.
  void record() {
    behave("unsynced");
    for (int tries = 0; tries < 20 && whole_pairs_ < 2; ++tries) {
      recording_ = (folder_.path() / ("recording" + std::to_string(tries) + ".oni")).string();
      ASSERT_EQ(openni::OpenNI::initialize(), openni::STATUS_OK);
      openni::Device device;
      ASSERT_EQ(device.open(kCamera), openni::STATUS_OK);
      openni::VideoStream colour, depth;
      ASSERT_EQ(colour.create(device, openni::SENSOR_COLOR), openni::STATUS_OK);
      ASSERT_EQ(depth.create(device, openni::SENSOR_DEPTH), openni::STATUS_OK);
      openni::Recorder recorder;
      ASSERT_EQ(recorder.create(recording_.c_str()), openni::STATUS_OK);
      ASSERT_EQ(recorder.attach(colour, false), openni::STATUS_OK);
      ASSERT_EQ(recorder.attach(depth, false), openni::STATUS_OK);
      ASSERT_EQ(recorder.start(), openni::STATUS_OK);
      ASSERT_EQ(depth.start(), openni::STATUS_OK);
      ASSERT_EQ(colour.start(), openni::STATUS_OK);
      std::this_thread::sleep_for(std::chrono::milliseconds(25 * kFrames + 500));
      recorder.stop();
      recorder.destroy();
      colour.stop(), depth.stop();
      colour.destroy(), depth.destroy();
      device.close();
      openni::OpenNI::shutdown();
      whole_pairs_ = pairs_in(recording_);
    }
    ASSERT_GE(whole_pairs_, 2) << "too little was recorded to say anything";
  }
  std::string recording_;
  int whole_pairs_ = 0;
  test::TemporaryFolder folder_;
};

TEST_F(Openni2, ListsCameras) {
  const std::vector<FoundCamera> found = module().list();
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].device, kCamera);
  EXPECT_EQ(found[0].description, "Stillmap Test camera");
}

TEST_F(Openni2, TheLensIsAsTheFieldOfViewSays) {
  const std::optional<DeviceLens> lens = module().lens(request());
  ASSERT_TRUE(lens.has_value());
  EXPECT_NEAR(lens->fx, 0.8 * kWidth, 1e-3);
  EXPECT_NEAR(lens->fy, 0.8 * kWidth, 1e-3);
  behave("lensless");
  EXPECT_FALSE(module().lens(request()).has_value());
  EXPECT_FALSE(module().lens(request("no-such-camera")).has_value());
}

TEST_F(Openni2, DeliversWhatTheCameraShows) {
  const auto camera = driver(request());
  const Status opened = camera->open();
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  ASSERT_TRUE(camera->start().ok());
  Slot slot;
  int frames = 0, last = -1;
  long heap = 0;
  Nanoseconds stamp_before = 0;
  for (int silences = 0; silences < (frames < 2 ? 20 : 1);) {  // the camera has shown all
    const GrabResult result = grab(*camera, slot, frames > 0 ? &heap : nullptr);
    silences += result.status == GrabStatus::Timeout;
    if (result.status != GrabStatus::Frame) continue;  // this machine may be too busy for some
    const int n = slot.number();
    EXPECT_GT(n, last);
    EXPECT_EQ(slot.depth_ns - slot.colour_ns, 4'000'000);
    if (frames > 0) {
      EXPECT_EQ(slot.colour_ns - stamp_before, (n - last) * 33'333'000LL);
    }
    EXPECT_LT(std::abs(monotonic_now() - slot.colour_ns), 5'000'000'000);
    stamp_before = slot.colour_ns;
    last = n;
    ++frames;
  }
  EXPECT_GE(frames, 2);
  EXPECT_EQ(heap, 0) << "what the library takes for a picture, it takes on its own thread";
  camera->stop();
}

TEST_F(Openni2, TheFirstCameraIsTakenWithoutAName) {
  const auto camera = driver(request(""));
  EXPECT_TRUE(camera->open().ok());
}

TEST_F(Openni2, RegistrationIsVerified) {
  for (const char* how : {"unregistered", "liar"}) {
    behave(how);
    EXPECT_THAT(refusal(request()),
                HasSubstr("does not register depth to colour by itself; describe its depth camera"))
        << how;
    CameraRequest raw = request();
    raw.register_depth = false;
    EXPECT_EQ(refusal(raw), "") << how;
  }
}

TEST_F(Openni2, UnpluggingIsSeenAndItCanBeOpenedAgain) {
  behave("unplug");
  {
    const auto camera = driver(request());
    ASSERT_TRUE(camera->open().ok());
    ASSERT_TRUE(camera->start().ok());
    Slot slot;
    GrabResult result{GrabStatus::Frame};
    for (int i = 0; i < 20 && result.status != GrabStatus::Lost; ++i) result = grab(*camera, slot);
    EXPECT_EQ(result.status, GrabStatus::Lost);
    camera->stop();
  }
  behave("");
  const auto again = driver(request());
  ASSERT_TRUE(again->open().ok());
  ASSERT_TRUE(again->start().ok());
  Slot slot;
  EXPECT_NE(grab(*again, slot).status, GrabStatus::Lost);
  again->stop();
}

TEST_F(Openni2, RefusalsNameTheMend) {
  CameraRequest wanted = request();
  wanted.width = 65;
  EXPECT_THAT(refusal(wanted),
              testing::AllOf(HasSubstr("has no colour of 65x48 px at 30 Hz"), HasSubstr("64x48@30")));
  wanted = request();
  wanted.depth_units_per_m = 5000;
  EXPECT_THAT(refusal(wanted), HasSubstr("let camera.depth_units_per_m be 1000 or 10000"));
  wanted = request();
  wanted.colour_format = "GREY";
  EXPECT_THAT(refusal(wanted), HasSubstr("has no colour of 64x48 px at 30 Hz as GREY"));
  EXPECT_THAT(refusal(request("no-such-camera")), HasSubstr("cannot be opened"));
  EXPECT_THAT(refusal(request("/no/such/file.oni")), HasSubstr("/no/such/file.oni: is not there"));
}

TEST_F(Openni2, ARecordingReplaysWhole) {
  ASSERT_NO_FATAL_FAILURE(record());
  const auto recording = driver(request(recording_));
  const Status opened = recording->open();
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  ASSERT_TRUE(recording->start().ok());
  EXPECT_TRUE(recording->describe().is_log);
  Slot slot;
  std::vector<int> played;
  long heap = 0;
  GrabStatus status = GrabStatus::Frame;
  while (status != GrabStatus::EndOfStream && status != GrabStatus::Lost) {
    const long before = test::heap_calls();
    status = recording->grab(slot, 0).status;  // a log has no deadline
    heap += played.empty() ? 0 : test::heap_calls() - before;
    if (status == GrabStatus::Frame) played.push_back(slot.number());
  }
  EXPECT_EQ(status, GrabStatus::EndOfStream);
  EXPECT_GE(static_cast<int>(played.size()), whole_pairs_);
  for (std::size_t i = 1; i < played.size(); ++i) EXPECT_GT(played[i], played[i - 1]);
  EXPECT_EQ(heap, 0) << "pictures are given back on the library's thread";
  recording->stop();
}

TEST_F(Openni2, ADamagedRecordingEndsWhereItIsDamaged) {
  ASSERT_NO_FATAL_FAILURE(record());
  test::Bytes bytes = test::read_file(recording_);
  // From the first picture's pixels to what stands at the end, which is needed to open it.
  constexpr std::array kEnd{std::byte{'N'}, std::byte{'I'}, std::byte{'R'}, std::byte{0}, std::byte{7}};
  const auto end = std::search(bytes.begin(), bytes.end(), kEnd.begin(), kEnd.end());
  ASSERT_GT(end - bytes.begin(), 8'000);
  std::fill(bytes.begin() + 8'000, end, std::byte{0});
  test::write_file(recording_, bytes);
  const auto recording = driver(request(recording_));
  ASSERT_TRUE(recording->open().ok());
  ASSERT_TRUE(recording->start().ok());
  Slot slot;
  GrabResult result{GrabStatus::Frame};
  while (result.status != GrabStatus::EndOfStream && result.status != GrabStatus::Lost)
    result = recording->grab(slot, 0);
  EXPECT_EQ(result.status, GrabStatus::Lost);
  recording->stop();
}

}  // namespace
}  // namespace stillmap
