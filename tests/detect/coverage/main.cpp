// SPDX-License-Identifier: Apache-2.0
// stillmap-coverage LOG [--config FILE | --set KEY=VALUE ...]
//
// How much of the people in a log the detector finds. LOG is in the TUM layout, with groundtruth.txt (boxes
// are carried with the true pose) and mask/<colour stamp>.png (0 background, else a person's number). Prints
// one JSON object. A view is a person in a frame, of over 6,000 pixels; it is covered when 60 % of its pixels
// are.
#include <time.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/config.h"
#include "detect/box_carrier.h"
#include "detect/detector.h"
#include "detect/model_file.h"
#include "eval/trajectory.h"
#include "segment/segment.h"
#include "tests/support/read_image.h"

namespace stillmap {
namespace {

constexpr int kLeastPixels = 6000;
constexpr double kLeastShare = 0.6;

double thread_cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

/// The pose with the nearest stamp.
Pose pose_at(const std::vector<StampedPose>& poses, Nanoseconds stamp_ns) {
  const auto nearer = [&](const StampedPose& a, const StampedPose& b) {
    return std::abs(a.stamp_ns - stamp_ns) < std::abs(b.stamp_ns - stamp_ns);
  };
  return std::min_element(poses.begin(), poses.end(), nearer)->T_world_camera;
}

struct Coverage {
  int views = 0, by_found = 0, by_carried = 0, by_mask = 0;
  double background = 0, background_in_found = 0, background_in_mask = 0;

  void add(const Detections& found, const Detections& carried, const DynamicMask& mask,
           ImageView<const std::uint8_t> truth, ImageView<const std::uint16_t> depth,
           const CameraModel& camera) {
    struct Person {
      int pixels = 0, found = 0, carried = 0, mask = 0;
    };
    std::map<int, Person> people;
    for (int y = 0; y < truth.height; ++y) {
      for (int x = 0; x < truth.width; ++x) {
        const bool in_found = in_moving_box(found, x, y), in_carried = in_moving_box(carried, x, y);
        // Where the depth is unknown, nothing is tracked or mapped unless the mask says more.
        const Label label = label_at(mask, x, y, camera.depth_m(depth.at(x, y)));
        const bool masked = label == Label::Dynamic || label == Label::Unknown;
        if (const int id = truth.at(x, y); id != 0) {
          Person& p = people[id];
          p.pixels += 1, p.found += in_found, p.carried += in_carried, p.mask += masked;
        } else {
          background += 1, background_in_found += in_found, background_in_mask += label == Label::Dynamic;
        }
      }
    }
    for (const auto& [id, p] : people) {
      if (p.pixels <= kLeastPixels) continue;
      views += 1;
      by_found += p.found >= kLeastShare * p.pixels;
      by_carried += p.carried >= kLeastShare * p.pixels;
      by_mask += p.mask >= kLeastShare * p.pixels;
    }
  }

  static bool in_moving_box(const Detections& boxes, int x, int y) {
    return std::any_of(boxes.items.begin(), boxes.items.end(), [&](const Detection& d) {
      return d.kind == ClassKind::Dynamic && d.box.contains(x, y);
    });
  }
};

int measure(const std::filesystem::path& log, const Config& config) {
  const auto model = find_model(config.detector);
  if (!model.ok()) return std::fprintf(stderr, "%s\n", model.error().message.c_str()), 3;
  const auto opened = Detector::open(config, model.value());
  if (!opened.ok()) return std::fprintf(stderr, "%s\n", opened.error().message.c_str()), 3;
  const auto poses = read_trajectory(log / "groundtruth.txt");
  if (!poses.ok()) return std::fprintf(stderr, "%s\n", poses.error().message.c_str()), 3;
  BoxCarrier carrier(config.camera, config.detector);
  Coverage coverage;
  std::vector<double> cpu_ms;
  for (const test::RgbdFiles& files : test::list_rgbd(log)) {
    const test::Image<Bgr> colour = test::read_colour(files.colour);
    const test::Image<std::uint16_t> depth = test::read_depth(files.depth);
    const test::Image<std::uint8_t> truth =
        test::read_grey(log / "mask" / files.colour.stem().concat(".png"));
    if (truth.width != colour.width || depth.width != colour.width)
      return std::fprintf(stderr, "%s: colour, depth and mask must be there, of one size\n",
                          files.colour.c_str()),
             3;
    FrameSlot frame;
    frame.colour_ns = static_cast<Nanoseconds>(std::stod(files.colour.stem()) * 1e9);
    // The detector only reads; a frame's own view is writable because drivers fill it.
    frame.colour = {const_cast<Bgr*>(colour.pixels.data()), colour.width, colour.height, colour.width};
    Detections found, carried;
    const double start_ms = thread_cpu_ms();
    if (!opened.value()->run(frame, found)) return std::fputs("the network failed\n", stderr), 1;
    cpu_ms.push_back(thread_cpu_ms() - start_ms);
    measure_depths(found, depth.view(), config.camera);
    const Pose T_world_camera = pose_at(poses.value(), frame.colour_ns);
    carrier.update(found, T_world_camera);
    carrier.carry(frame.colour_ns, T_world_camera, carried);
    DynamicMask mask;
    segment(carried, depth.view(), config.camera, DynamicRule::Silhouette, mask);
    coverage.add(found, carried, mask, truth.view(), depth.view(), config.camera);
  }
  if (cpu_ms.empty()) return std::fprintf(stderr, "%s: no frames in associations.txt\n", log.c_str()), 3;
  std::sort(cpu_ms.begin(), cpu_ms.end());
  std::printf(
      "{\"frames\": %zu, \"views\": %d, \"covered_by_boxes\": %.4f, \"covered_by_carried\": %.4f, "
      "\"covered_by_mask\": "
      "%.4f, \"background_in_boxes\": %.4f, \"background_in_mask\": %.4f, \"cpu_ms_median\": %.2f}\n",
      cpu_ms.size(), coverage.views, 1.0 * coverage.by_found / std::max(1, coverage.views),
      1.0 * coverage.by_carried / std::max(1, coverage.views),
      1.0 * coverage.by_mask / std::max(1, coverage.views),
      coverage.background_in_found / coverage.background, coverage.background_in_mask / coverage.background,
      cpu_ms[cpu_ms.size() / 2]);
  return 0;
}

}  // namespace
}  // namespace stillmap

int main(int argc, char** argv) {
  std::vector<std::string> files, keys;
  for (int i = 2; i + 1 < argc; i += 2)
    (std::string(argv[i]) == "--set" ? keys : files).emplace_back(argv[i + 1]);
  if (argc < 2 || argc % 2 != 0)
    return std::fputs("usage: stillmap-coverage LOG [--config FILE | --set KEY=VALUE ...]\n", stderr), 2;
  const auto config = stillmap::load_config_of_model(files, keys);
  if (!config.ok()) return std::fprintf(stderr, "%s\n", config.error().message.c_str()), 2;
  return stillmap::measure(argv[1], config.value().config);
}
