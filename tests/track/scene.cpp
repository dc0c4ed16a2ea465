// SPDX-License-Identifier: Apache-2.0
#include "scene.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

namespace stillmap::test {

namespace {

/// `visit` sees each part of a frame as bytes; where there are no people, nothing is kept of them.
template <class Visit>
void for_each_part(synthetic::SyntheticFrame& frame, bool people, Visit visit) {
  const auto part = [&](auto& values) {
    values.resize(640 * 480);
    visit(reinterpret_cast<char*>(values.data()),
          static_cast<std::streamsize>(values.size() * sizeof(values[0])));
  };
  part(frame.colour);
  part(frame.depth);
  if (people) {
    part(frame.mask);
    part(frame.true_depth_m);
  } else {
    frame.mask.assign(640 * 480, 0);
    frame.true_depth_m.clear();
  }
}

/// What one test has rendered is read by all others, of every build: most of a tracker's test is rendering,
/// seconds a picture where a processor is emulated.
void render_once(synthetic::SyntheticLog& log, int index, synthetic::SyntheticFrame& frame) {
  const synthetic::SyntheticOptions& o = log.options();
  std::ostringstream name;
  name << STILLMAP_RENDERINGS "/" << o.seed << '-' << o.people << '-' << static_cast<int>(o.path) << '-'
       << o.noise << '-' << index;
  const std::string file = name.str();

  std::ifstream kept(file, std::ios::binary);
  for_each_part(frame, o.people > 0, [&](char* data, std::streamsize bytes) { kept.read(data, bytes); });
  frame.stamp_ns = log.stamp_ns(index);
  frame.T_world_camera = log.T_world_camera(frame.stamp_ns);
  if (kept) return;

  log.render(index, frame);
  std::error_code ignored;
  std::filesystem::create_directories(STILLMAP_RENDERINGS, ignored);
  const std::string part = file + '.' + std::to_string(getpid());  // others may render it, too
  std::ofstream out(part, std::ios::binary);
  for_each_part(frame, o.people > 0, [&](char* data, std::streamsize bytes) { out.write(data, bytes); });
  out.close();
  if (out) std::filesystem::rename(part, file, ignored);
}

}  // namespace

Config synthetic_config() {
  Config config;
  config.camera = synthetic::SyntheticLog::camera();
  return config;
}

Image<std::uint8_t> grey_of(const std::vector<Bgr>& colour, int width, int height) {
  Image<std::uint8_t> grey(width, height);
  std::ranges::transform(colour, grey.pixels.begin(), luma);
  return grey;
}

Scene::Scene(synthetic::SyntheticLog& log, int index) {
  render_once(log, index, truth);
  grey = grey_of(truth.colour, 640, 480);
}

FrameSlot Scene::slot(std::uint64_t sequence) {
  FrameSlot slot;
  slot.sequence = sequence;
  slot.colour_ns = slot.depth_ns = truth.stamp_ns;
  slot.colour = {truth.colour.data(), 640, 480, 640};
  slot.depth = {truth.depth.data(), 640, 480, 640};
  return slot;
}

DynamicMask Scene::mask() const {
  DynamicMask mask;
  mask.rule = DynamicRule::Silhouette;
  mask.columns = 80;
  mask.rows = 60;
  constexpr double kMargin_mm = 150;
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) {
      const auto i = static_cast<std::size_t>(y * 640 + x);
      if (truth.mask[i] == 0) continue;
      const double mm = 1000.0 * truth.true_depth_m[i];
      DynamicMask::Cell& cell = mask.cells[static_cast<std::size_t>(y / 8 * 80 + x / 8)];
      const auto near = static_cast<std::uint16_t>(std::max(1.0, mm - kMargin_mm));
      const auto far = static_cast<std::uint16_t>(mm + kMargin_mm);
      cell.near_mm = cell.label == Label::Dynamic ? std::min(cell.near_mm, near) : near;
      cell.far_mm = std::max(cell.far_mm, far);
      cell.label = Label::Dynamic;
    }
  }
  return mask;
}

void blur(Scene& scene) {
  constexpr int kWidth = 640, kHeight = 480, kReach = 16;
  const auto mean_of = [&](std::size_t first, std::size_t stride, int count) {
    std::vector<Bgr> line(static_cast<std::size_t>(count));
    for (std::size_t i = 0; i < line.size(); ++i) line[i] = scene.truth.colour[first + i * stride];
    for (int i = 0; i < count; ++i) {
      int b = 0, g = 0, r = 0;
      for (int d = -kReach; d <= kReach; ++d) {
        const Bgr& c = line[static_cast<std::size_t>(std::clamp(i + d, 0, count - 1))];
        b += c.b, g += c.g, r += c.r;
      }
      constexpr int kPixels = 2 * kReach + 1;
      scene.truth.colour[first + static_cast<std::size_t>(i) * stride] = {
          static_cast<std::uint8_t>(b / kPixels), static_cast<std::uint8_t>(g / kPixels),
          static_cast<std::uint8_t>(r / kPixels)};
    }
  };
  for (std::size_t y = 0; y < kHeight; ++y) mean_of(y * kWidth, 1, kWidth);
  for (std::size_t x = 0; x < kWidth; ++x) mean_of(x, kWidth, kHeight);
}

double gaussian(Random& random) {
  return std::sqrt(-2 * std::log(1 - random.uniform())) * std::cos(2 * std::numbers::pi * random.uniform());
}

Vec3 gaussian_vec(Random& random, double sigma) {
  const double x = gaussian(random), y = gaussian(random), z = gaussian(random);
  return {sigma * x, sigma * y, sigma * z};
}

Feature feature_of(const CameraModel& camera, Vec3 p_camera, Label label) {
  const Vec2 pixel = camera.project(p_camera);
  Feature f;
  f.x = static_cast<float>(pixel.x);
  f.y = static_cast<float>(pixel.y);
  f.ray_x = static_cast<float>(p_camera.x / p_camera.z);
  f.ray_y = static_cast<float>(p_camera.y / p_camera.z);
  f.depth_m = static_cast<float>(p_camera.z);
  f.label = label;
  return f;
}

Descriptor random_descriptor(Random& random) {
  Descriptor d;
  for (std::uint64_t& word : d.bits) word = random.next();
  return d;
}

double angle_between(const Pose& a, const Pose& b) {
  return norm(log_so3(transposed(a.R) * b.R));
}

}  // namespace stillmap::test
