// SPDX-License-Identifier: Apache-2.0
// The networks that $STILLMAP_BENCH_MODELS names (int8, fp32, ...), side by side on one picture.
#include <benchmark/benchmark.h>

#include <cstdlib>
#include <sstream>

#include "detect/detector.h"
#include "scene.h"

namespace stillmap {
namespace {

void detector(benchmark::State& state, const std::string& model) {
  auto loaded = load_config(
      std::vector<std::string>{STILLMAP_SOURCE_DIR "/firmware-config/cameras/synthetic.toml"}, {});
  const Result<ModelFile> file = read_model(model);
  if (!file.ok()) {
    state.SkipWithError(file.error().message.c_str());
    return;
  }
  auto opened = Detector::open(loaded.value().config, file.value());
  if (!opened.ok()) {
    state.SkipWithError(opened.error().message.c_str());
    return;
  }
  synthetic::SyntheticLog log({.seed = 3, .people = 2});
  test::Scene scene(log, 10);
  const FrameSlot slot = scene.slot(0);
  Detections found;
  for (auto _ : state) benchmark::DoNotOptimize(opened.value()->run(slot, found));
}

[[maybe_unused]] const bool kRegistered = [] {
  const char* models = std::getenv("STILLMAP_BENCH_MODELS");
  std::istringstream words(models == nullptr ? "" : models);
  for (std::string model; words >> model;) {
    const std::string name = "detector/" + model.substr(model.rfind('/') + 1);
    benchmark::RegisterBenchmark(name.c_str(), detector, model)->Unit(benchmark::kMicrosecond);
  }
  return true;
}();

}  // namespace
}  // namespace stillmap
