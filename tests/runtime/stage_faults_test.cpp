// SPDX-License-Identifier: Apache-2.0
// Stages that are too slow, in the running pipeline. Who waits for whom is set by counts, never by a clock.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "tests/runtime/running.h"
#include "tests/runtime/short_memory.h"
#include "tests/support/temporary_folder.h"

namespace stillmap::test {
namespace {

using Grab = ScriptedDriver::Grab;

/// A camera that is never too fast, unless the tracker is made too slow for it.
class Slowable {
 public:
  Slowable()
      : driver_({.name = "wall", .width = WallScene::kWidth, .height = WallScene::kHeight},
                wall_frames(100'000), [this](int, FrameSlot& slot) { deliver(slot); }),
        pipeline(driver_, {}, true, config()) {
    pipeline.context->on_work = [this](Stage stage) {
      if (stage == Stage::Track) track();
    };
  }
  void slow(bool is) { slow_ = is; }

  struct Change {
    int step = 0;
    std::uint64_t processed = 0, detector_runs = 0;
  };
  std::vector<Change> changes{{}};  ///< the track thread's: read it when the run has ended

 private:
  static Config config() {
    Config config = WallScene::config();
    config.mount.fps = 0.01;  // only lost frames are late then, on a machine of any speed
    config.track.features = 300;
    config.map.fuse_every = 8;
    return config;
  }
  bool stopping() const { return pipeline.stop.load(); }
  void deliver(FrameSlot& slot) {
    wait_until([this] { return slow_ || stopping() || pipeline.unfinished() == 0; });
    const int round = next_++ % 400;
    scene_.draw(round < 200 ? round : 399 - round, slot);
  }
  /// A slow tracker comes to a frame when others have been lost.
  void track() {
    const std::uint64_t lost = pipeline.dropped();
    wait_until([&] { return !slow_ || stopping() || pipeline.dropped() > lost; });
    const RunCounters& c = pipeline.context->counters;
    const int step = pipeline.context->quality.load();
    if (step != changes.back().step) changes.push_back({step, c.processed.load(), c.detector_runs.load()});
  }

  const WallScene scene_;
  int next_ = 0;
  std::atomic<bool> slow_{false};
  ScriptedDriver driver_;

 public:
  Pipeline pipeline;
};

TEST(StageFaults, ASlowTrackerGivesUpQualityInTheDocumentedOrderAndTakesItBack) {
  Slowable slowable;
  Pipeline& pipeline = slowable.pipeline;
  const RunCounters& c = pipeline.context->counters;
  constexpr int kLast = static_cast<int>(kSheddingPlan.size()) - 1;
  Running running(pipeline);
  running.wait_for_frames(40);  // the first second does not count
  slowable.slow(true);
  wait_until([&] { return pipeline.context->quality.load() == kLast; });
  slowable.slow(false);
  const std::uint64_t patience = c.processed.load() + 2000;
  const auto is_back = [&] { return pipeline.context->quality.load() == 0; };
  wait_until([&] { return is_back() || c.processed.load() > patience; });
  const bool came_back = is_back();
  running.wait_for_frames(c.processed.load() + 5);
  running.stop_s();
  pipeline.expect_accounted();
  if (!came_back && c.map_ring.refused.load() > 0)
    GTEST_SKIP() << "this machine lets the map wait, which is a reason to give up quality, too";

  const auto& changes = slowable.changes;
  const auto reaches = [](int step) { return [step](const auto& change) { return change.step == step; }; };
  const auto lowest = std::find_if(changes.begin(), changes.end(), reaches(kLast)), next = std::next(lowest);
  ASSERT_NE(std::find_if(lowest, changes.end(), reaches(0)), changes.end());
  // One after the other; some more, where a busy machine lets the map wait.
  for (std::size_t i = 1; i < changes.size(); ++i)
    EXPECT_EQ(std::abs(changes[i].step - changes[i - 1].step), 1) << i;
  // While the last step held, the detector was given every sixth frame.
  EXPECT_LE(next->detector_runs - lowest->detector_runs, (next->processed - lowest->processed) / 6 + 2);
  EXPECT_EQ(c.quality_lowered.load() - c.quality_raised.load(),
            static_cast<std::uint64_t>(pipeline.context->quality.load()));
  EXPECT_GT(c.frames_shed.load(), 6u * 90);
}

TEST(StageFaults, ADetectorWhoseLibraryThrowsIsDoneWithoutUntilItRunsAgain) {
  PatientCamera camera(wall_frames(100'000));
  Pipeline pipeline(camera.driver, {}, true);
  camera.pipeline = &pipeline;
  RunContext& context = *pipeline.context;
  std::atomic<bool> throws{false};
  context.on_work = [&](Stage stage) {
    if (stage == Stage::Detect) set_short_of_memory(throws);
  };
  const RunCounters& c = context.counters;
  Running running(pipeline);
  wait_until([&] { return c.detector_runs.load() >= 3; });
  throws = true;
  wait_until([&] { return c.detector_failures.load() >= 5; });
  const std::uint64_t runs = c.detector_runs.load(), processed = c.processed.load();
  running.wait_for_frames(processed + 10);
  EXPECT_EQ(c.detector_runs.load(), runs);
  throws = false;
  wait_until([&] { return c.detector_runs.load() >= runs + 5; });
  running.stop_s();
  EXPECT_EQ(c.lost.load(), 0u);
  EXPECT_EQ(pipeline.dropped(), 0u);
  EXPECT_GT(context.stages.map.map().occupied_voxels(), 0u);
  pipeline.expect_accounted();
}

TEST(StageFaults, AMapSlowerThanTheTrackerIsAskedForLessAndItsGrowthIsSeen) {
  std::vector<Grab> grabs = wall_frames(100'000);
  for (Grab& g : grabs) g.picture = g.picture % 400 < 200 ? g.picture % 400 : 399 - g.picture % 400;
  PatientCamera camera(grabs);
  Pipeline pipeline(camera.driver);
  camera.pipeline = &pipeline;
  RunContext& context = *pipeline.context;
  const RunCounters& c = context.counters;
  // Two more frames are tracked before it begins with one, so its ring is never empty.
  std::atomic<bool> slow{true};
  std::atomic<std::uint64_t> begun{0}, fused{0};
  context.on_work = [&](Stage stage) {
    if (stage != Stage::Map) return;
    fused = context.stages.map.map().fused_frames();
    ++begun;
    const std::uint64_t before = c.processed.load();
    wait_until([&] { return !slow || c.processed.load() >= before + 2; });
  };
  Running running(pipeline);
  wait_until([&] { return context.quality.load() == static_cast<int>(kSheddingPlan.size()) - 1; });
  EXPECT_GT(c.blocks.high_water.load(), 0u);
  const auto after = [&](std::uint64_t frames) {
    const std::uint64_t until = begun.load() + frames;
    wait_until([&] { return begun.load() >= until; });
    return fused.load();
  };
  const std::uint64_t at_first = after(5), at_last = after(40);
  // With fuse_every 2 and a quarter of the fusion, and a frame of two.
  EXPECT_LE(at_last - at_first, 40u * 2 / 8 + 5);
  slow = false;
  running.stop_s();
  pipeline.expect_accounted();
}

/// A disk that stalls: the recorder opens a picture's file, which is a pipe that nobody reads yet.
class StalledDisk {
 public:
  explicit StalledDisk(int stalled_frame) {
    std::filesystem::create_directories(folder_ / "rgb");
    const std::string stamp = std::to_string(WallScene::stamp_ns(stalled_frame));
    pipe_ = folder_ /
            ("rgb/" + stamp.substr(0, stamp.size() - 9) + "." + stamp.substr(stamp.size() - 9) + ".jpg");
    EXPECT_EQ(mkfifo(pipe_.c_str(), 0600), 0);
  }
  ~StalledDisk() {
    if (reader_.joinable()) reader_.join();
  }
  std::string folder() const { return folder_.path(); }
  void go_on() {
    reader_ =
        std::thread([this] { std::ifstream(pipe_).ignore(std::numeric_limits<std::streamsize>::max()); });
  }
  std::uint64_t lines() const {
    std::ifstream list(folder_ / "associations.txt");
    return static_cast<std::uint64_t>(std::count(std::istreambuf_iterator<char>(list), {}, '\n'));
  }

 private:
  TemporaryFolder folder_;
  std::string pipe_;
  std::thread reader_;
};

/// A pipeline that records.
struct Recording {
  Recording(RgbdDriver& driver, const StalledDisk& disk, RunMode mode, bool with_detector)
      : pipeline(driver, options(disk, mode), with_detector),
        recorder({.folder = disk.folder(),
                  .width = WallScene::kWidth,
                  .height = WallScene::kHeight,
                  .camera_profile = {}}) {
    EXPECT_TRUE(recorder.open().ok());
    lane.emplace(recorder, pipeline.config.record.buffer_frames, pipeline.context->counters);
    pipeline.context->record = &*lane;
  }
  static RunOptions options(const StalledDisk& disk, RunMode mode) {
    RunOptions o;
    o.mode = mode;
    o.record = disk.folder();
    return o;
  }
  Pipeline pipeline;
  Recorder recorder;
  std::optional<RecordLane> lane;
};

TEST(StageFaults, CaptureNeverStarvesWhileTheDiskStallsAndEveryStageHoldsAllItMay) {
  StalledDisk disk(5);
  std::vector<Grab> grabs = wall_frames(100'000);
  for (Grab& g : grabs) g.takes_ns = 2'000'000;
  auto driver = wall_driver(false, grabs);
  Recording recording(driver, disk, RunMode::Live, true);
  Pipeline& pipeline = recording.pipeline;
  const RunCounters& c = pipeline.context->counters;
  Gate gate(*pipeline.context);
  Running running(pipeline);
  running.wait_for_frames(1);
  gate.hold(Stage::Detect);
  gate.hold(Stage::Map);
  running.wait_for_frames(c.processed.load() + 8);
  gate.hold(Stage::Track);
  // The disk's buffer is full, too: of what comes now nothing has a place there.
  const std::uint64_t offered = c.offered.load();
  wait_until([&] { return c.offered.load() >= offered + 60 && c.recorded.load() >= 5; });
  EXPECT_GE(c.record_left_out.load(), 30u);
  EXPECT_EQ(pipeline.dropped(DropReason::NoFreeSlot), 0u);
  EXPECT_EQ(c.recorded.load(), 5u);
  gate.release_all();
  disk.go_on();
  wait_until([&] { return c.recorded.load() >= 20; });
  EXPECT_LT(running.stop_s(), kStopDeadline_s);
  recording.lane->finish();
  EXPECT_EQ(c.recorded.load() + c.record_left_out.load(), c.offered.load());
  EXPECT_EQ(c.record_failed.load(), 0u);
  EXPECT_EQ(disk.lines(), c.recorded.load());
  EXPECT_EQ(pipeline.dropped(DropReason::NoFreeSlot), 0u);
  pipeline.expect_accounted();
}

TEST(StageFaults, TheEndOfTheStreamComesWhileTheDiskStallsAndNothingIsLostInFastMode) {
  StalledDisk disk(30);
  auto driver = wall_driver(true, wall_frames(32));  // the buffer holds what comes after
  Recording recording(driver, disk, RunMode::Fast, false);
  run_threads(*recording.pipeline.context);
  const RunCounters& c = recording.pipeline.context->counters;
  EXPECT_EQ(c.processed.load(), 32u);
  EXPECT_LT(c.recorded.load(), 32u);
  disk.go_on();
  recording.lane->finish();
  EXPECT_EQ(c.recorded.load(), 32u);
  EXPECT_EQ(disk.lines(), 32u);
  recording.pipeline.expect_accounted();
}

}  // namespace
}  // namespace stillmap::test
