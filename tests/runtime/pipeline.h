// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "runtime/run.h"
#include "runtime/run_context.h"
#include "runtime/run_plan.h"
#include "tests/detect/tiny_onnx.h"
#include "tests/runtime/scripted_driver.h"
#include "tests/runtime/wall_scene.h"

namespace stillmap::test {

/// A source that shows the wall scene, each picture when `wait` returns.
inline ScriptedDriver wall_driver(
    bool is_log, std::vector<ScriptedDriver::Grab> grabs, std::function<void()> wait = [] {}) {
  static const WallScene scene;
  return ScriptedDriver(
      {.name = "wall", .width = WallScene::kWidth, .height = WallScene::kHeight, .fps = 30, .is_log = is_log},
      std::move(grabs), [wait = std::move(wait)](int picture, FrameSlot& slot) {
        wait();
        scene.draw(picture, slot);
      });
}
inline std::vector<ScriptedDriver::Grab> wall_frames(int count) {
  std::vector<ScriptedDriver::Grab> grabs;
  for (int i = 0; i < count; ++i) grabs.push_back({.stamp_ns = WallScene::stamp_ns(i), .picture = i});
  return grabs;
}

/// A network that sees the scene's blue thing, cell by cell.
inline std::unique_ptr<Detector> blue_detector(const Config& config) {
  TinyOnnx net(config.detector.input_height, config.detector.input_width);
  net.add_output("cls_32", 1, 32, {-5}, {3, -3, -3});
  std::vector<float> bins(32, -20.f);
  for (std::size_t side = 0; side < 4; ++side) bins[side * 8 + 1] = 20;
  net.add_output("reg_32", 32, 32, bins, std::vector<float>(96, 0.f));
  auto opened =
      Detector::open(config, {.path = "blue.onnx", .bytes = net.bytes(), .sha256 = {}, .warning = {}});
  EXPECT_TRUE(opened.ok()) << opened.error().message;
  return opened.ok() ? std::move(opened.value()) : nullptr;
}

/// What `run` sets up, with a driver of the test's own.
struct Pipeline {
  explicit Pipeline(RgbdDriver& driver, RunOptions o = {}, bool with_detector = false,
                    Config c = WallScene::config())
      : config(std::move(c)),
        options(std::move(o)),
        parts{.detector = with_detector,
              .stream = config.stream.listen != "off",
              .log = driver.describe().is_log,
              .lockstep_delay = options.detector.delay,
              .recorder_frames =
                  options.record.empty() ? 0 : RecordLane::frames_held(config.record.buffer_frames),
              .trajectory_poses = 10'000},
        arena(planned_bytes(config, parts)),
        detector(with_detector ? blue_detector(config) : nullptr),
        stages(std::make_unique<Stages>(arena, config, parts)),
        context(std::make_unique<RunContext>(config, options, options.mode.value_or(RunMode::Realtime),
                                             driver, detector.get(), *stages, stop)) {}
  static std::size_t planned_bytes(const Config& config, const Stages::Parts& parts) {
    Arena planning;
    plan_memory(planning, config, parts);
    return planning.bytes_planned();
  }

  std::uint64_t dropped() const {
    std::uint64_t sum = 0;
    for (const auto& count : context->counters.dropped) sum += count.load();
    return sum;
  }
  /// Frames that the source has delivered and nobody is done with.
  std::uint64_t unfinished() const {
    return context->counters.offered.load() - context->counters.processed.load() - dropped();
  }
  std::uint64_t dropped(DropReason reason) const {
    return context->counters.dropped[static_cast<std::size_t>(reason)].load();
  }
  /// What holds after every run, however it ended.
  void expect_accounted() const {
    const RunCounters& c = context->counters;
    EXPECT_EQ(c.offered.load(), c.processed.load() + dropped());
    EXPECT_EQ(context->track_log.causal.size(), c.tracked.load() + c.weak.load());
    EXPECT_EQ(context->track_log.capture_to_pose.count(), c.tracked.load() + c.weak.load());
    EXPECT_EQ(context->track_log.track_time.count(), c.processed.load());
    EXPECT_EQ(context->track_log.track_cpu_time.count(), c.processed.load());
    for (std::size_t i = 1; i < context->track_log.causal.size(); ++i) {
      EXPECT_LT(context->track_log.causal[i - 1].stamp_ns, context->track_log.causal[i].stamp_ns);
    }
    for (const StampedPose& pose : context->track_log.causal) EXPECT_TRUE(is_finite(pose.T_world_camera));
    // An eighth is left for what no test has met.
    for (const PoolMark& stack : c.stacks) {
      EXPECT_LE(stack.high_water.load(), stack.capacity.load() - stack.capacity.load() / 8)
          << stack.name.load();
    }
  }

  Config config;
  RunOptions options;
  Stages::Parts parts;
  std::atomic<bool> stop{false};
  Arena arena;
  std::unique_ptr<Detector> detector;
  std::unique_ptr<Stages> stages;  // its pool aborts where a run has kept a frame
  std::unique_ptr<RunContext> context;
};

}  // namespace stillmap::test
