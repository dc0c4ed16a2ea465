// SPDX-License-Identifier: Apache-2.0
#include "runtime/flight_recorder.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace stillmap {
namespace {

using ::testing::HasSubstr;

constexpr Nanoseconds kSecond = 1'000'000'000;

struct Bench {
  explicit Bench(std::size_t room = 400) : frames(room), recorder(frames, path) {}
  void record(int first, int count) {
    for (int i = first; i < first + count; ++i) {
      FlightFrame f{.at_ns = i * kSecond / 30,
                    .stamp_ns = i,
                    .sequence = static_cast<std::uint64_t>(i),
                    .state = TrackState::Tracking,
                    .matches = 300,
                    .inliers = 200,
                    .labels = {1, 2, 3, 4},
                    .T_map_camera = {}};
      f.T_map_camera.t = {-0.001234, 2, 0};
      recorder.put(f);
      if (i % 30 == 0) recorder.take_in();
    }
    recorder.take_in();
  }
  std::vector<std::string> lines() const {
    std::vector<std::string> found;
    std::ifstream in(path);
    for (std::string line; std::getline(in, line);) {
      if (line[0] != '#') found.push_back(line);
    }
    return found;
  }
  const test::TemporaryFolder folder;
  const std::string path = folder / "flight";
  std::vector<FlightFrame> frames;
  FlightRecorder recorder;
};

TEST(FlightRecorder, WritesTheLastTenSeconds) {
  Bench bench;
  bench.recorder.put(
      Event{.stamp_ns = 0, .stage = Stage::Map, .code = EventCode::StageLate});  // too long ago
  bench.recorder.put(Event{.stamp_ns = 39 * kSecond,
                           .stage = Stage::Track,
                           .code = EventCode::TrackingLost,
                           .sequence = 1170,
                           .a = std::numeric_limits<std::int64_t>::min()});
  bench.record(0, 1200);
  ASSERT_TRUE(bench.recorder.write());
  const auto lines = bench.lines();
  ASSERT_EQ(lines.size(), 301u + 1u);
  EXPECT_EQ(lines.front(),
            "frame 29966666666 899 899 tracking 300 200 1 2 3 4 -1234 2000000 0 0 0 0 1000000");
  EXPECT_THAT(lines[300], HasSubstr(" 1199 1199 tracking"));
  EXPECT_EQ(lines.back(), "event 39000000000 track tracking_lost 1170 -9223372036854775808");
}

TEST(FlightRecorder, KeepsTheNewestWhenThereIsLittleRoom) {
  Bench bench(10);
  bench.record(0, 95);
  ASSERT_TRUE(bench.recorder.write());
  const auto lines = bench.lines();
  ASSERT_EQ(lines.size(), 10u);
  EXPECT_THAT(lines.front(), HasSubstr(" 85 85 tracking"));
}

TEST(FlightRecorder, ATrackThatComesAndGoesIsWrittenOnceInTenSeconds) {
  Bench bench;
  bench.record(0, 30);
  EXPECT_TRUE(bench.recorder.write_unless_just_done(100 * kSecond));
  std::filesystem::remove(bench.path);
  EXPECT_TRUE(bench.recorder.write_unless_just_done(109 * kSecond));
  EXPECT_FALSE(std::filesystem::exists(bench.path));
  EXPECT_TRUE(bench.recorder.write_unless_just_done(111 * kSecond));
  EXPECT_TRUE(std::filesystem::exists(bench.path));
}

TEST(FlightRecorder, AFileThatCannotBeWrittenIsToldAndNoPathIsNothing) {
  std::vector<FlightFrame> room(4);
  FlightRecorder nowhere(room, "/nobody/has/this");
  EXPECT_FALSE(nowhere.write());
  FlightRecorder off({}, "");
  off.put(FlightFrame{});
  off.take_in();
  EXPECT_FALSE(off.enabled());
}

TEST(FlightRecorder, APipeIsNoFileAndNobodyWaitsForItsReader) {
  Bench bench;
  bench.record(0, 30);
  ASSERT_EQ(mkfifo(bench.path.c_str(), 0600), 0);
  EXPECT_FALSE(bench.recorder.write());
  const int reader = open(bench.path.c_str(), O_RDONLY | O_NONBLOCK);
  EXPECT_FALSE(bench.recorder.write());
  char byte = 0;
  EXPECT_EQ(read(reader, &byte, 1), 0) << "nothing was written";
  close(reader);
}

TEST(FlightRecorderDeathTest, AnAbortWritesWhatWasStillOnTheWay) {
  Bench bench;
  EXPECT_EXIT(
      {
        bench.recorder.put(FlightFrame{.sequence = 77});
        const WriteOnAbort on_abort(bench.recorder);
        STILLMAP_CHECK(bench.frames.empty());
      },
      ::testing::KilledBySignal(SIGABRT), "bug: bench.frames.empty");
  ASSERT_EQ(bench.lines().size(), 1u);
  EXPECT_THAT(bench.lines()[0], HasSubstr(" 77 initializing"));
}

TEST(FlightRecorderDeathTest, AfterItsLifeAnAbortIsAnAbort) {
  Bench bench;
  EXPECT_EXIT(
      {
        { const WriteOnAbort on_abort(bench.recorder); }
        std::abort();
      },
      ::testing::KilledBySignal(SIGABRT), "");
  EXPECT_FALSE(std::filesystem::exists(bench.path));
}

}  // namespace
}  // namespace stillmap
