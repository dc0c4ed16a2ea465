// SPDX-License-Identifier: Apache-2.0
#include "drivers/recorder/recorder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <vector>

#include "drivers/tum_log/tum_log.h"
#include "tests/drivers/pictures/picture_files.h"
#include "tests/support/frame.h"
#include "tests/support/heap_calls.h"

namespace stillmap {
namespace {

constexpr int kWidth = 64, kHeight = 48;

struct Slot : test::Frame {
  Slot() : Frame(kWidth, kHeight) {}
  void draw(int n) {
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        colour.at(x, y) = {static_cast<std::uint8_t>(2 * x + n), static_cast<std::uint8_t>(5 * y),
                           static_cast<std::uint8_t>(200 - 3 * n)};
        depth.at(x, y) = static_cast<std::uint16_t>(x * 1021 + y * 37 + n);
      }
    }
    // Nanoseconds, and depth half a slow frame late: 40 ms, more than the benchmark's 20 ms window.
    colour_ns = 1'305'031'102'175'304'123 + n * 80'000'001LL;
    depth_ns = colour_ns + 40'000'000;
  }
};

class RecorderFolder : public testing::Test {
 protected:
  Recorder::Setup setup(bool exact = false) const {
    return {.folder = (folder_.path() / "log").string(),
            .width = kWidth,
            .height = kHeight,
            .exact_colour = exact,
            .jpeg_quality = 95,
            .camera_profile = "camera.fx = 525\n"};
  }
  std::vector<Slot> replay() const {
    TumLog log((folder_.path() / "log").string(), kWidth, kHeight);
    const Status opened = log.open();
    EXPECT_TRUE(opened.ok()) << opened.error().message;
    std::vector<Slot> frames;
    if (!opened.ok()) return frames;
    EXPECT_TRUE(log.start().ok());
    Slot slot;
    for (GrabResult r = log.grab(slot, 0); r.status != GrabStatus::EndOfStream; r = log.grab(slot, 0)) {
      EXPECT_EQ(r.status, GrabStatus::Frame) << to_string(r.reason);
      Slot& kept = frames.emplace_back();
      kept.colour_ns = slot.colour_ns, kept.depth_ns = slot.depth_ns;
      kept.colour_pixels = slot.colour_pixels, kept.depth_pixels = slot.depth_pixels;
    }
    return frames;
  }
  test::TemporaryFolder folder_;
};

TEST_F(RecorderFolder, WhatItWritesReplaysToTheSameFrames) {
  Recorder recorder(setup(true));
  ASSERT_TRUE(recorder.open().ok());
  Slot slot;
  for (int n = 0; n < 5; ++n) {
    slot.draw(n);
    const long before = test::heap_calls();
    ASSERT_TRUE(recorder.write(slot));
    EXPECT_EQ(test::heap_calls(), before);
  }
  recorder.close();
  const std::vector<Slot> frames = replay();
  ASSERT_EQ(frames.size(), 5u);
  for (int n = 0; n < 5; ++n) {
    slot.draw(n);
    const Slot& played = frames[static_cast<std::size_t>(n)];
    EXPECT_EQ(played.colour_ns, slot.colour_ns);
    EXPECT_EQ(played.depth_ns, slot.depth_ns);
    EXPECT_EQ(played.depth_pixels, slot.depth_pixels);
    EXPECT_EQ(
        std::memcmp(played.colour_pixels.data(), slot.colour_pixels.data(), sizeof(Bgr) * kWidth * kHeight),
        0);
  }
  const test::Bytes profile = test::read_file(folder_.path() / "log/camera.toml");
  EXPECT_EQ(std::string(reinterpret_cast<const char*>(profile.data()), profile.size()), "camera.fx = 525\n");
}

TEST_F(RecorderFolder, JpegKeepsColourNearAndDepthExact) {
  Recorder recorder(setup());
  ASSERT_TRUE(recorder.open().ok());
  Slot slot;
  slot.draw(3);
  ASSERT_TRUE(recorder.write(slot));
  recorder.close();
  const std::vector<Slot> frames = replay();
  ASSERT_EQ(frames.size(), 1u);
  EXPECT_EQ(frames[0].depth_pixels, slot.depth_pixels);
  for (std::size_t i = 0; i < slot.colour_pixels.size(); ++i)
    ASSERT_NEAR(frames[0].colour_pixels[i].g, slot.colour_pixels[i].g, 12);
}

TEST_F(RecorderFolder, ALowerQualityMakesSmallerFiles) {
  const auto bytes_of_colour = [this](const char* name, int quality) {
    Recorder::Setup wanted = setup();
    wanted.folder = (folder_.path() / name).string();
    wanted.jpeg_quality = quality;
    Recorder recorder(wanted);
    EXPECT_TRUE(recorder.open().ok());
    Slot slot;
    slot.draw(3);
    EXPECT_TRUE(recorder.write(slot));
    return std::filesystem::directory_iterator(folder_.path() / name / "rgb")->file_size();
  };
  EXPECT_LT(bytes_of_colour("rough", 30), bytes_of_colour("fine", 95));
}

TEST_F(RecorderFolder, WithoutAnEndItPlaysAllThatWasWritten) {
  // A process that dies runs no destructors; the lists must be whole all the same.
  EXPECT_EXIT(
      {
        Recorder recorder(setup());
        Slot slot;
        bool good = recorder.open().ok();
        for (int n = 0; n < 4; ++n) {
          slot.draw(n);
          good = good && recorder.write(slot);
        }
        _exit(good ? 17 : 1);
      },
      testing::ExitedWithCode(17), "");
  EXPECT_EQ(replay().size(), 4u);
}

TEST_F(RecorderFolder, AFullDiskLeavesNoHalfLineThatTheNextOneWouldJoin) {
  // Files may not grow beyond a limit here, which the lists reach first: they are longer than a picture.
  const auto in_child = [this] {
    signal(SIGXFSZ, SIG_IGN);
    const auto size = [this](const std::filesystem::path& name) {
      return std::filesystem::file_size(folder_.path() / "log" / name);
    };
    Recorder recorder(setup());
    Slot slot;
    bool good = recorder.open().ok();
    std::uintmax_t largest = 0;
    int n = 0;
    for (; n < 4 || size("associations.txt") < largest + 100; ++n) {
      slot.draw(n);
      good = good && recorder.write(slot);
      for (const char* folder : {"rgb", "depth"}) {
        for (const auto& file : std::filesystem::directory_iterator(folder_.path() / "log" / folder))
          largest = std::max(largest, file.file_size());
      }
    }
    const rlimit full{size("associations.txt") + 20, RLIM_INFINITY}, room{RLIM_INFINITY, RLIM_INFINITY};
    setrlimit(RLIMIT_FSIZE, &full);
    slot.draw(n);
    good = good && !recorder.write(slot);
    setrlimit(RLIMIT_FSIZE, &room);
    slot.draw(n + 1);
    good = good && recorder.write(slot);
    recorder.close();
    _exit(good && replay().size() == static_cast<std::size_t>(n) + 1 ? 17 : 1);
  };
  EXPECT_EXIT(in_child(), testing::ExitedWithCode(17), "");
}

TEST_F(RecorderFolder, AFullDiskLeavesNoHalfPicture) {
  const auto in_child = [this] {
    signal(SIGXFSZ, SIG_IGN);
    Recorder recorder(setup());
    Slot slot;
    slot.draw(0);
    const bool good = recorder.open().ok();
    const rlimit full{100, RLIM_INFINITY};
    setrlimit(RLIMIT_FSIZE, &full);
    _exit(good && !recorder.write(slot) && std::filesystem::is_empty(folder_.path() / "log/rgb") ? 17 : 1);
  };
  EXPECT_EXIT(in_child(), testing::ExitedWithCode(17), "");
}

TEST_F(RecorderFolder, AFrameThatCannotBeWrittenIsInNoList) {
  Recorder recorder(setup());
  ASSERT_TRUE(recorder.open().ok());
  Slot slot;
  slot.draw(0);
  ASSERT_TRUE(recorder.write(slot));
  std::filesystem::remove_all(folder_.path() / "log/depth");
  slot.draw(1);
  EXPECT_FALSE(recorder.write(slot));
  std::filesystem::create_directory(folder_.path() / "log/depth");
  slot.draw(2);
  EXPECT_TRUE(recorder.write(slot));
  recorder.close();
  const test::Bytes list = test::read_file(folder_.path() / "log/associations.txt");
  EXPECT_EQ(std::count(list.begin(), list.end(), std::byte{'\n'}), 2);
}

TEST_F(RecorderFolder, RefusesAFolderThatHoldsALogOrCannotBe) {
  {
    Recorder first(setup());
    ASSERT_TRUE(first.open().ok());
  }
  Recorder again(setup());
  EXPECT_THAT(again.open().error().message, testing::HasSubstr("holds a log or a camera.toml already"));
  folder_.write("own/camera.toml", "somebody's");
  Recorder::Setup beside = setup();
  beside.folder = (folder_.path() / "own").string();
  EXPECT_THAT(Recorder(beside).open().error().message, testing::HasSubstr("camera.toml already"));
  EXPECT_EQ(folder_.read("own/camera.toml").size(), 10u);
  Recorder::Setup nowhere = setup();
  nowhere.folder = "/no/such/folder/log";
  EXPECT_THAT(Recorder(nowhere).open().error().message,
              testing::HasSubstr("--record /no/such/folder/log: cannot be made"));
  folder_.write("file", "");
  nowhere.folder = (folder_.path() / "file").string();
  EXPECT_THAT(Recorder(nowhere).open().error().message, testing::HasSubstr("give a folder"));
}

}  // namespace
}  // namespace stillmap
