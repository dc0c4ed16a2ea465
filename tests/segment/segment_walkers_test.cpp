// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>

#include "core/time.h"
#include "segment/segment.h"
#include "tests/support/read_image.h"
#include "tests/support/shared_folder.h"

namespace stillmap {
namespace {

CameraModel kinect() {
  CameraModel camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 517;
  camera.cx = 318.6;
  camera.cy = 255.3;
  camera.depth_units_per_m = 5000;
  return camera;
}

/// The true walkers' boxes: those of at least 400 pixels.
Detections true_boxes(const test::Image<std::uint8_t>& mask) {
  Detections boxes;
  for (int id = 1; id <= 2; ++id) {
    int x0 = mask.width, y0 = mask.height, x1 = 0, y1 = 0, count = 0;
    for (int y = 0; y < mask.height; ++y) {
      for (int x = 0; x < mask.width; ++x) {
        if (mask.view().at(x, y) != id) continue;
        x0 = std::min(x0, x), x1 = std::max(x1, x + 1), y0 = std::min(y0, y), y1 = std::max(y1, y + 1);
        ++count;
      }
    }
    if (count < 400) continue;
    Detection d;
    d.box = {static_cast<float>(x0), static_cast<float>(y0), static_cast<float>(x1), static_cast<float>(y1)};
    d.kind = ClassKind::Dynamic;
    d.score = 1;
    EXPECT_TRUE(boxes.items.try_push_back(d));
  }
  return boxes;
}

/// Pixels with depth: of walkers, of background in the boxes, and of background outside; and those called
/// Dynamic.
struct Tally {
  double walker = 0, walker_found = 0, inside = 0, inside_wrong = 0, outside = 0, outside_wrong = 0;
};

void count(const DynamicMask& mask, const test::Image<std::uint8_t>& truth,
           const test::Image<std::uint16_t>& depth, const CameraModel& camera, Tally& t) {
  for (int y = 0; y < truth.height; ++y) {
    for (int x = 0; x < truth.width; ++x) {
      const double z_m = camera.depth_m(depth.view().at(x, y));
      if (z_m <= 0) continue;
      const bool dynamic = label_at(mask, x, y, z_m) == Label::Dynamic;
      const bool in_box = std::any_of(mask.boxes.items.begin(), mask.boxes.items.end(),
                                      [&](const Detection& d) { return d.box.contains(x, y); });
      if (truth.view().at(x, y) != 0) {
        t.walker += 1, t.walker_found += dynamic;
      } else if (in_box) {
        t.inside += 1, t.inside_wrong += dynamic;
      } else {
        t.outside += 1, t.outside_wrong += dynamic;
      }
    }
  }
}

TEST(SegmentWalkers, FindsThePeopleAndKeepsTheRoom) {
  STILLMAP_NEEDS_SHARED();
  const std::filesystem::path folder = test::shared_folder() / "data/fr1_rpy_walkers";
  const CameraModel camera = kinect();
  Tally total;
  std::vector<double> times_ms;
  DynamicMask mask;
  for (const test::RgbdFiles& files : test::list_rgbd(folder)) {
    test::Image<std::uint8_t> truth = test::read_grey(folder / "mask" / files.colour.stem().concat(".png"));
    test::Image<std::uint16_t> depth = test::read_depth(files.depth);
    ASSERT_EQ(truth.width, 640);
    ASSERT_EQ(depth.width, 640);
    const Detections boxes = true_boxes(truth);
    if (boxes.items.empty()) continue;
    const Nanoseconds start = monotonic_now();
    segment(boxes, depth.view(), camera, DynamicRule::Silhouette, mask);
    times_ms.push_back(to_ms(monotonic_now() - start));
    Tally one;
    count(mask, truth, depth, camera, one);
    total.walker += one.walker, total.walker_found += one.walker_found;
    total.inside += one.inside, total.inside_wrong += one.inside_wrong;
    total.outside += one.outside, total.outside_wrong += one.outside_wrong;
    if (getenv("DBG"))
      std::printf("%s  boxes %zu walker %6.0f found %.3f  inside %6.0f wrong %.3f  outside wrong %.4f\n",
                  files.colour.stem().c_str(), boxes.items.size(), one.walker, one.walker_found / one.walker,
                  one.inside, one.inside_wrong / std::max(1.0, one.inside),
                  one.outside_wrong / std::max(1.0, one.outside));
  }
  std::sort(times_ms.begin(), times_ms.end());
  std::printf(
      "%zu frames: walkers found %.4f, background in boxes taken %.4f, beyond %.5f; median %.3f ms, max "
      "%.3f\n",
      times_ms.size(), total.walker_found / total.walker, total.inside_wrong / total.inside,
      total.outside_wrong / total.outside, times_ms[times_ms.size() / 2], times_ms.back());
  EXPECT_GT(total.walker_found / total.walker, 0.9);
  EXPECT_LT(total.inside_wrong / total.inside, 0.2);
}

}  // namespace
}  // namespace stillmap
