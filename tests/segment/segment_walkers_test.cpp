// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <time.h>

#include <algorithm>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "detect/detector.h"
#include "segment/segment.h"
#include "tests/support/read_image.h"
#include "tests/support/shared_folder.h"

namespace stillmap {
namespace {

Config kinect() {
  const std::vector<std::string> files{STILLMAP_SOURCE_DIR "/firmware-config/cameras/tum-fr1.toml"};
  return load_config(files, {}).value().config;
}

double thread_cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

struct Moment {
  test::Image<Bgr> colour;
  test::Image<std::uint16_t> depth;
  test::Image<std::uint8_t> truth;  ///< 0 background, 1 and 2 the walkers
};

/// The boxes around the walkers of at least 400 pixels.
Detections true_boxes(const Moment& moment) {
  Detections boxes;
  for (int id = 1; id <= 2; ++id) {
    int x0 = moment.truth.width, y0 = moment.truth.height, x1 = 0, y1 = 0, pixels = 0;
    for (int y = 0; y < moment.truth.height; ++y) {
      for (int x = 0; x < moment.truth.width; ++x) {
        if (moment.truth.view().at(x, y) != id) continue;
        x0 = std::min(x0, x), x1 = std::max(x1, x + 1), y0 = std::min(y0, y), y1 = std::max(y1, y + 1);
        ++pixels;
      }
    }
    if (pixels < 400) continue;
    Detection d;
    d.box = {static_cast<float>(x0), static_cast<float>(y0), static_cast<float>(x1), static_cast<float>(y1)};
    d.kind = ClassKind::Dynamic;
    EXPECT_TRUE(boxes.items.try_push_back(d));
  }
  return boxes;
}

/// Pixels with depth, and how many of them the mask calls Dynamic.
struct Tally {
  double walker = 0, walker_in_box = 0, inside = 0, outside = 0;
  double walker_found = 0, walker_in_box_found = 0, inside_taken = 0, outside_taken = 0;

  void add(const DynamicMask& mask, const Moment& moment, const CameraModel& camera) {
    for (int y = 0; y < moment.truth.height; ++y) {
      for (int x = 0; x < moment.truth.width; ++x) {
        const double z_m = camera.depth_m(moment.depth.view().at(x, y));
        if (z_m <= 0) continue;
        const bool dynamic = label_at(mask, x, y, z_m) == Label::Dynamic;
        const bool in_box = std::any_of(
            mask.boxes.items.begin(), mask.boxes.items.end(),
            [&](const Detection& d) { return d.kind == ClassKind::Dynamic && d.box.contains(x, y); });
        if (moment.truth.view().at(x, y) != 0) {
          walker += 1, walker_found += dynamic;
          if (in_box) walker_in_box += 1, walker_in_box_found += dynamic;
        } else {
          (in_box ? inside : outside) += 1;
          (in_box ? inside_taken : outside_taken) += dynamic;
        }
      }
    }
  }
};

/// Segments every frame of the log that has boxes or walkers.
Tally over_the_log(const char* name, const Config& config,
                   const std::function<Detections(const Moment&)>& boxes_of) {
  const std::filesystem::path folder = test::shared_folder() / "data/fr1_rpy_walkers";
  Tally tally;
  std::vector<double> cpu_ms;
  DynamicMask mask;
  for (const test::RgbdFiles& files : test::list_rgbd(folder)) {
    const Moment moment{test::read_colour(files.colour), test::read_depth(files.depth),
                        test::read_grey(folder / "mask" / files.colour.stem().concat(".png"))};
    EXPECT_EQ(moment.truth.width * moment.depth.width * moment.colour.width, 640 * 640 * 640);
    const Detections boxes = boxes_of(moment);
    const double start_ms = thread_cpu_ms();
    segment(boxes, moment.depth.view(), config.camera, DynamicRule::Silhouette, mask);
    if (!boxes.items.empty()) cpu_ms.push_back(thread_cpu_ms() - start_ms);
    tally.add(mask, moment, config.camera);
  }
  std::sort(cpu_ms.begin(), cpu_ms.end());
  std::printf(
      "%s, %zu frames with boxes: walkers' pixels found %.3f (in a box: %.3f of %.3f), background taken in "
      "boxes %.3f, "
      "outside %.4f; CPU median %.3f ms, max %.3f ms\n",
      name, cpu_ms.size(), tally.walker_found / tally.walker, tally.walker_in_box_found / tally.walker_in_box,
      tally.walker_in_box / tally.walker, tally.inside_taken / tally.inside,
      tally.outside_taken / tally.outside, cpu_ms[cpu_ms.size() / 2], cpu_ms.back());
  return tally;
}

TEST(SegmentWalkers, TrueBoxes) {
  STILLMAP_NEEDS_SHARED();
  const Tally t = over_the_log("true boxes", kinect(), true_boxes);
  EXPECT_GT(t.walker_found, 0.93 * t.walker);
  EXPECT_LT(t.inside_taken, 0.2 * t.inside);
  EXPECT_LT(t.outside_taken, 0.01 * t.outside);
}

TEST(SegmentWalkers, DetectedBoxes) {
  STILLMAP_NEEDS_SHARED();
  const Config config = kinect();
  const auto model = read_model(test::shared_folder() / "models/nanodet_plus_m/nanodet_plus_m_int8.onnx");
  ASSERT_TRUE(model.ok()) << model.error().message;
  const auto opened = Detector::open(config, model.value());
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  const Tally t = over_the_log("detected boxes", config, [&](const Moment& moment) {
    FrameSlot frame;
    // The detector only reads; a frame's own view is writable because drivers fill it.
    frame.colour = {const_cast<Bgr*>(moment.colour.pixels.data()), 640, 480, 640};
    Detections found;
    EXPECT_TRUE(opened.value()->run(frame, found));
    return found;
  });
  EXPECT_GT(t.walker_in_box_found, 0.85 * t.walker_in_box);
}

}  // namespace
}  // namespace stillmap
