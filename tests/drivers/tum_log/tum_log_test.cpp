// SPDX-License-Identifier: Apache-2.0
#include "drivers/tum_log/tum_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <fstream>
#include <tuple>

#include "tests/drivers/pictures/picture_files.h"
#include "tests/support/frame.h"
#include "tests/support/heap_calls.h"
#include "tests/support/shared_folder.h"

namespace stillmap {
namespace {

using test::JpegKind;
using test::PngKind;
using testing::HasSubstr;

constexpr int kWidth = 16, kHeight = 12;

class TumLogFolder : public testing::Test {
 protected:
  static test::Bytes colour(int width = kWidth, int height = kHeight) {
    return test::png_file(PngKind::Rgb8, width, height,
                          std::vector<std::uint16_t>(static_cast<std::size_t>(3 * width * height), 77));
  }
  static test::Bytes depth(int width = kWidth, int height = kHeight) {
    return test::png_file(PngKind::Grey16, width, height,
                          std::vector<std::uint16_t>(static_cast<std::size_t>(width * height), 5000));
  }
  void write(const std::string& name, const test::Bytes& bytes) {
    test::write_file(folder_.path() / name, bytes);
  }
  /// Writes n good frames 0.1 s apart, rgb/0.png ... and depth/0.png ..., and their list.
  void write_good(int n) {
    std::string list;
    for (int i = 0; i < n; ++i) {
      const std::string k = std::to_string(i);
      write("rgb/" + k + ".png", colour());
      write("depth/" + k + ".png", depth());
      list += "1." + k + " rgb/" + k + ".png 1." + k + "01 depth/" + k + ".png\n";
    }
    folder_.write("associations.txt", list);
  }
  /// Plays the log to its end: "frame" or the reason, for each.
  std::vector<std::string> play(TumLog& log) {
    std::vector<std::string> story;
    test::Frame slot(kWidth, kHeight);
    for (GrabResult r = log.grab(slot, 0); r.status != GrabStatus::EndOfStream; r = log.grab(slot, 0)) {
      story.push_back(r.status == GrabStatus::Frame ? "frame" : to_string(r.reason));
    }
    return story;
  }
  std::vector<std::string> play() {
    TumLog log(folder_.path().string(), kWidth, kHeight);
    const Status opened = log.open();
    EXPECT_TRUE(opened.ok()) << opened.error().message;
    EXPECT_TRUE(log.start().ok());
    return play(log);
  }
  test::TemporaryFolder folder_;
};

TEST_F(TumLogFolder, LoopsGoForwardsAndBackwardsInTurn) {
  write_good(3);
  folder_.write("associations.txt",
                "1.0 rgb/0.png 1.010 depth/0.png\n1.1 rgb/none.png 1.100 depth/1.png\n"
                "1.2 rgb/2.png 1.195 depth/2.png\n");
  TumLog log(folder_.path().string(), kWidth, kHeight, 3);
  ASSERT_TRUE(log.open().ok());
  EXPECT_EQ(log.colour_stamps().size(), 3u);
  for (int start = 0; start < 2; ++start) {
    ASSERT_TRUE(log.start().ok());
    std::vector<Nanoseconds> colour_ms, depth_ms;
    test::Frame slot(kWidth, kHeight);
    for (int i = 0; i < 9; ++i) {
      const GrabResult r = log.grab(slot, 0);
      ASSERT_EQ(r.status == GrabStatus::Frame, i % 3 != 1) << i;
      if (r.status != GrabStatus::Frame) continue;
      colour_ms.push_back(slot.colour_ns / 1'000'000);
      depth_ms.push_back(slot.depth_ns / 1'000'000);
    }
    EXPECT_EQ(log.grab(slot, 0).status, GrabStatus::EndOfStream);
    // The middle frame has no picture. Each pass begins one interval (100 ms) after the end of the one
    // before; backwards in time, depth that was taken later comes earlier.
    EXPECT_EQ(colour_ms, (std::vector<Nanoseconds>{1000, 1200, 1300, 1500, 1600, 1800}));
    EXPECT_EQ(depth_ms, (std::vector<Nanoseconds>{1010, 1195, 1305, 1490, 1610, 1795}));
  }
}

TEST_F(TumLogFolder, DeliversPixelsAndBothStamps) {
  write_good(2);
  TumLog log(folder_.path().string(), kWidth, kHeight);
  ASSERT_TRUE(log.open().ok());
  ASSERT_TRUE(log.start().ok());
  test::Frame slot(kWidth, kHeight);
  ASSERT_EQ(log.grab(slot, 0).status, GrabStatus::Frame);
  ASSERT_EQ(log.grab(slot, 0).status, GrabStatus::Frame);
  EXPECT_EQ(slot.colour_ns, 1'100'000'000);
  EXPECT_EQ(slot.depth_ns, 1'101'000'000);
  EXPECT_EQ(slot.colour.at(3, 4).g, 77);
  EXPECT_EQ(slot.depth.at(15, 11), 5000);
  EXPECT_EQ(log.grab(slot, 0).status, GrabStatus::EndOfStream);
  EXPECT_EQ(log.grab(slot, 0).status, GrabStatus::EndOfStream);
  ASSERT_TRUE(log.start().ok());
  EXPECT_EQ(play(log).size(), 2u) << "start goes back to the first frame";
}

TEST_F(TumLogFolder, DescribesItself) {
  write_good(4);
  TumLog log(folder_.path().string(), kWidth, kHeight);
  ASSERT_TRUE(log.open().ok());
  const SourceInfo info = log.describe();
  EXPECT_EQ(info.name, "tum:" + folder_.path().string());
  EXPECT_EQ(info.width, kWidth);
  EXPECT_EQ(info.height, kHeight);
  EXPECT_NEAR(info.fps, 10, 1e-9);
  EXPECT_TRUE(info.is_log);
  EXPECT_THAT(log.colour_stamps(),
              testing::ElementsAre(1'000'000'000, 1'100'000'000, 1'200'000'000, 1'300'000'000));
}

TEST_F(TumLogFolder, EveryDamageHasItsReasonAndTheLogGoesOn) {
  using testing::ElementsAre;
  write_good(9);
  std::filesystem::remove(folder_.path() / "rgb/0.png");
  std::filesystem::remove(folder_.path() / "depth/1.png");
  write("rgb/2.png", {});
  write("depth/3.png", {});
  write("rgb/4.png", test::Bytes(300, std::byte{'x'}));
  test::Bytes cut = depth();
  cut.resize(cut.size() / 2);
  write("depth/5.png", cut);
  write("rgb/6.png", colour(kWidth + 1, kHeight));
  write("depth/7.png", depth(kWidth, kHeight - 1));
  EXPECT_THAT(play(), ElementsAre("missing_file", "missing_file", "corrupt_colour", "corrupt_depth",
                                  "corrupt_colour", "corrupt_depth", "wrong_size", "wrong_size", "frame"));
}

TEST_F(TumLogFolder, StrangeThingsInPlaceOfFiles) {
  write_good(5);
  std::filesystem::remove(folder_.path() / "rgb/0.png");
  std::filesystem::create_directory(folder_.path() / "rgb/0.png");
  write("rgb/1.png", depth());
  write("depth/2.png", colour());
  // A file that no picture of this size can be: sparse, so that it costs nothing here.
  std::ofstream(folder_.path() / "rgb/3.png") << "x";
  std::filesystem::resize_file(folder_.path() / "rgb/3.png", std::uintmax_t{1} << 40);
  EXPECT_THAT(play(), testing::ElementsAre("missing_file", "corrupt_colour", "corrupt_depth",
                                           "corrupt_colour", "frame"));
}

TEST_F(TumLogFolder, MorePassesThanStampsCanTellAreRefused) {
  write_good(2);
  folder_.write("associations.txt",
                "0 rgb/0.png 0 depth/0.png\n1000000000 rgb/1.png 1000000000 depth/1.png\n");
  const auto open = [&](int loops) { return TumLog(folder_.path().string(), kWidth, kHeight, loops).open(); };
  EXPECT_TRUE(open(2).ok());
  const Status refused = open(3);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().exit_code, ExitCode::WrongConfig);
  EXPECT_THAT(refused.error().message, testing::HasSubstr("3 passes of 2000000000 s"));
}

TEST_F(TumLogFolder, FilesThatChangeAfterOpenAreDropped) {
  write_good(3);
  TumLog log(folder_.path().string(), kWidth, kHeight);
  ASSERT_TRUE(log.open().ok());
  ASSERT_TRUE(log.start().ok());
  test::Bytes grown = colour();
  grown.resize(grown.size() + 100'000);
  write("rgb/0.png", grown);
  std::filesystem::remove(folder_.path() / "depth/1.png");
  EXPECT_THAT(play(log), testing::ElementsAre("corrupt_colour", "missing_file", "frame"));
}

TEST_F(TumLogFolder, ColourWithoutDepthIsCountedWhenItsTurnComes) {
  write_good(3);
  std::filesystem::remove(folder_.path() / "associations.txt");
  folder_.write("rgb.txt", "1.0 rgb/0.png\n1.1 rgb/1.png\n1.05 rgb/1.png\n1.2 rgb/2.png\n");
  folder_.write("depth.txt", "1.0 depth/0.png\n1.05 depth/1.png\n1.2 depth/2.png\n");
  EXPECT_THAT(play(), testing::ElementsAre("frame", "no_depth_match", "time_jump", "frame"));
}

TEST_F(TumLogFolder, ColourMayBeJpegWhateverTheNameSays) {
  write_good(2);
  write("rgb/1.png", test::jpeg_file(JpegKind::ProgressiveColour, kWidth, kHeight,
                                     std::vector<std::uint8_t>(3 * kWidth * kHeight, 90)));
  EXPECT_THAT(play(), testing::ElementsAre("frame", "frame"));
}

TEST_F(TumLogFolder, NoUsablePairIsAnErrorAtOpen) {
  const auto error = [&] {
    TumLog log(folder_.path().string(), kWidth, kHeight);
    const Status status = log.open();
    EXPECT_FALSE(status.ok());
    if (status.ok()) return std::string();
    EXPECT_EQ(status.error().exit_code, ExitCode::UnreadableInput);
    return status.error().message;
  };
  const auto names_folder = HasSubstr(folder_.path().string());
  EXPECT_THAT(error(), testing::AllOf(names_folder, HasSubstr("it needs rgb.txt and depth.txt")));
  folder_.write("associations.txt", "# empty\n");
  EXPECT_THAT(error(), testing::AllOf(names_folder, HasSubstr("no usable pair")));
  folder_.write("associations.txt", "1.0 rgb/0.png 1.0 depth/0.png\n");
  EXPECT_THAT(error(), testing::AllOf(names_folder, HasSubstr("no usable pair among 1 listed")));
}

TEST_F(TumLogFolder, AnotherCamerasProfileIsRefusedAtOpenWithBothSizes) {
  const auto error = [&](int width, int height) {
    const Status status = TumLog(folder_.path().string(), width, height).open();
    if (status.ok()) return std::string();
    EXPECT_EQ(status.error().exit_code, ExitCode::WrongConfig);
    return status.error().message;
  };
  const auto names_both = testing::AllOf(HasSubstr(folder_.path().string()), HasSubstr("pictures are 16x12,"),
                                         HasSubstr("camera.width x camera.height says 640x480"));
  write_good(3);
  EXPECT_EQ(error(kWidth, kHeight), "");
  EXPECT_THAT(error(640, 480), names_both);
  std::filesystem::remove(folder_.path() / "rgb/0.png");  // what says nothing of its size is passed over
  write("depth/0.png", {});
  test::Bytes cut = colour();
  cut.resize(20);
  write("rgb/1.png", cut);
  EXPECT_THAT(error(640, 480), names_both);
  for (int i = 0; i < 3; ++i) {
    write("rgb/" + std::to_string(i) + ".png",
          test::jpeg_file(JpegKind::ProgressiveColour, kWidth, kHeight,
                          std::vector<std::uint8_t>(3 * kWidth * kHeight, 90)));
    write("depth/" + std::to_string(i) + ".png", depth(kWidth, kHeight + 1));
  }
  EXPECT_THAT(error(640, 480), names_both);
  EXPECT_THAT(error(kWidth, kHeight), HasSubstr("pictures are 16x13,"));
}

TEST_F(TumLogFolder, TheSlotsSizeCounts) {
  write_good(1);
  TumLog log(folder_.path().string(), kWidth, kHeight);
  ASSERT_TRUE(log.open().ok());
  ASSERT_TRUE(log.start().ok());
  test::Frame slot(kWidth, kHeight - 2);
  const GrabResult result = log.grab(slot, 0);
  EXPECT_EQ(result.status, GrabStatus::Dropped);
  EXPECT_EQ(result.reason, DropReason::WrongSize);
}

/// Plays a real log to its end, with the heap calls counted after the first frame: on ARM a thread's first
/// JPEG reads from the system what the processor can do.
struct Playback {
  int frames = 0, pairs_within_window = 0;
  long heap_calls = 0;
  std::array<std::int64_t, 4> first_frame{};  ///< sums of blue, green, red and depth
};
Playback play_real(const std::string& name, int width, int height) {
  TumLog log((test::shared_folder() / "data" / name).string(), width, height);
  EXPECT_TRUE(log.open().ok());
  EXPECT_TRUE(log.start().ok());
  test::Frame slot(width, height);
  Playback out;
  long before = 0;
  for (GrabResult r = log.grab(slot, 0); r.status != GrabStatus::EndOfStream; r = log.grab(slot, 0)) {
    if (r.status != GrabStatus::Frame) continue;
    out.pairs_within_window += std::abs(slot.colour_ns - slot.depth_ns) <= 20'000'000 ? 1 : 0;
    if (++out.frames > 1) continue;
    before = test::heap_calls();
    for (const Bgr& p : slot.colour_pixels) {
      out.first_frame[0] += p.b;
      out.first_frame[1] += p.g;
      out.first_frame[2] += p.r;
    }
    for (const std::uint16_t z : slot.depth_pixels) out.first_frame[3] += z;
  }
  out.heap_calls = test::heap_calls() - before;
  return out;
}

TEST(TumLogReal, TheHeapCounterSeesTheLibraries) {
  if (!test::counts_heap_calls()) GTEST_SKIP() << "a sanitizer owns the heap";
  const long before = test::heap_calls();
  const test::Bytes file = test::png_file(PngKind::Grey8, 4, 4, std::vector<std::uint16_t>(16));
  EXPECT_GT(test::heap_calls() - before, 5) << file.size();
}

TEST(TumLogReal, WholeLogsPlayWithoutTheHeap) {
  STILLMAP_NEEDS_SHARED();
  for (const auto& [name, width, height, frames] : {std::tuple("fr1_rpy", 640, 480, 180),
                                                    {"fr1_rpy_walkers", 640, 480, 180},
                                                    {"office_walk", 540, 360, 190}}) {
    const Playback played = play_real(name, width, height);
    EXPECT_EQ(played.frames, frames) << name;
    EXPECT_EQ(played.pairs_within_window, frames) << name;
    EXPECT_EQ(played.heap_calls, 0) << name;
  }
}

TEST(TumLogReal, PixelsAreThoseOfOtherDecoders) {
  STILLMAP_NEEDS_SHARED();
  // Summed once with a PNG reader over Python's zlib, and with OpenCV's JPEG reader.
  EXPECT_THAT(play_real("fr1_rpy", 640, 480).first_frame,
              testing::ElementsAre(41757121, 41516334, 45860736, 1186327619));
  const auto jpeg = play_real("fr1_rpy_walkers", 640, 480).first_frame;
  EXPECT_THAT((std::array{jpeg[0], jpeg[1], jpeg[2]}), testing::ElementsAre(41720963, 41521803, 45848648));
}

TEST(TumLogReal, AssociationByStampsEqualsThePublishedList) {
  STILLMAP_NEEDS_SHARED();
  for (const auto& [name, width, height] : {std::tuple{"fr1_rpy", 640, 480}, {"office_walk", 540, 360}}) {
    const std::filesystem::path real = test::shared_folder() / "data" / name;
    test::TemporaryFolder folder;
    for (const char* list : {"rgb.txt", "depth.txt"}) {
      test::write_file(folder.path() / list, test::read_file(real / list));
    }
    for (const char* pictures : {"rgb", "depth"}) {
      std::filesystem::create_directory_symlink(real / pictures, folder.path() / pictures);
    }
    TumLog own(folder.path().string(), width, height), published(real.string(), width, height);
    ASSERT_TRUE(own.open().ok());
    ASSERT_TRUE(published.open().ok());
    EXPECT_TRUE(std::ranges::equal(own.colour_stamps(), published.colour_stamps())) << name;
    if (std::string_view(name) == "fr1_rpy") {
      EXPECT_EQ(own.colour_stamps()[0], 1305031239529662000);
    }
    ASSERT_TRUE(own.start().ok());
    ASSERT_TRUE(published.start().ok());
    test::Frame a(width, height), b(width, height);
    for (GrabResult r = own.grab(a, 0); r.status != GrabStatus::EndOfStream; r = own.grab(a, 0)) {
      ASSERT_EQ(published.grab(b, 0).status, r.status);
      ASSERT_EQ(a.colour_ns, b.colour_ns);
      ASSERT_EQ(a.depth_ns, b.depth_ns);
    }
  }
}

}  // namespace
}  // namespace stillmap
