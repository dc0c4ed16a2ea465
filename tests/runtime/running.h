// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <ctime>
#include <fstream>
#include <functional>
#include <string>
#include <thread>

#include "tests/runtime/pipeline.h"

namespace stillmap::test {

/// What the contract gives the stages to stop, of an idle machine; a sanitizer makes them ten times slower.
#ifdef STILLMAP_SANITIZED
constexpr double kStopDeadline_s = 20;
#else
constexpr double kStopDeadline_s = 2;
#endif

/// For how long somebody had to wait for a processor so far; 0 where the kernel does not say.
inline double waited_for_processors_s() {
  std::ifstream pressure("/proc/pressure/cpu");
  for (std::string word; pressure >> word;) {
    if (word.starts_with("total=")) return std::stod(word.substr(6)) / 1e6;
  }
  return 0;
}

/// The run on a thread of its own, as the program's main thread is.
struct Running {
  explicit Running(Pipeline& p) : pipeline(p), thread([&p] { run_threads(*p.context); }) {}
  /// Asks for the end; how long that takes where nobody else is busy: what this process worked, or went by
  /// without anybody's waiting for a processor, and a tenth of all that went by.
  double stop_s() {
    pipeline.stop.store(true);
    const Nanoseconds begin = monotonic_now();
    const std::clock_t worked = std::clock();
    const double waited_s = waited_for_processors_s();
    thread.join();
    const double went_by_s = to_seconds(monotonic_now() - begin);
    return std::max({static_cast<double>(std::clock() - worked) / CLOCKS_PER_SEC,
                     went_by_s - (waited_for_processors_s() - waited_s), went_by_s / 10});
  }
  void wait_for_frames(std::uint64_t count) const {
    while (pipeline.context->counters.processed.load() < count)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  Pipeline& pipeline;
  std::thread thread;
};

/// Holds stages up at their next piece of work.
class Gate {
 public:
  explicit Gate(RunContext& context) {
    context.on_work = [this](Stage stage) {
      std::atomic<bool>& held = held_[static_cast<std::size_t>(stage)];
      while (held.load()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    };
  }
  void hold(Stage stage) { held_[static_cast<std::size_t>(stage)] = true; }
  void release_all() {
    for (auto& held : held_) held = false;
  }

 private:
  std::array<std::atomic<bool>, kStageCount> held_{};
};

inline void wait_until(const std::function<bool()>& good) {
  while (!good()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

/// A camera of the wall scene that is never too fast: however slow the machine, every good frame is tracked.
struct PatientCamera {
  explicit PatientCamera(const std::vector<ScriptedDriver::Grab>& grabs)
      : driver(wall_driver(false, grabs,
                           [this] { wait_until([this] { return pipeline->unfinished() == 0; }); })) {}
  PatientCamera(const PatientCamera&) = delete;
  PatientCamera& operator=(const PatientCamera&) = delete;
  ScriptedDriver driver;
  const Pipeline* pipeline = nullptr;  ///< to be set before it runs
};

}  // namespace stillmap::test
