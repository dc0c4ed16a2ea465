// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_log/synthetic_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>

#include "core/config.h"
#include "tests/support/synthetic_log/ray_caster.h"

namespace stillmap::synthetic {
namespace {

namespace fs = std::filesystem;

constexpr int kWidth = 640, kHeight = 480;
constexpr std::size_t at(int x, int y) {
  return static_cast<std::size_t>(y * kWidth + x);
}

/// Whether depth is smooth and free of people around a pixel, so that half a pixel more or less does not
/// matter.
bool calm(const SyntheticFrame& f, int x, int y) {
  for (int dy = -2; dy <= 2; ++dy) {
    for (int dx = -2; dx <= 2; ++dx) {
      const std::size_t i = at(x + dx, y + dy);
      if (f.mask[i] != 0 || std::abs(f.true_depth_m[i] - f.true_depth_m[at(x, y)]) > 0.03f) return false;
    }
  }
  return true;
}

struct Agreement {
  int compared = 0, agree = 0, seen_through = 0;
};

/// Carries the fixed surfaces that frame a measured into frame b by the ground truth alone.
Agreement compare(const SyntheticFrame& a, const SyntheticFrame& b, double noise_sigmas) {
  const CameraModel camera = SyntheticLog::camera();
  const Pose T_b_a = inverse(b.T_world_camera) * a.T_world_camera;
  Agreement result;
  for (int y = 4; y < kHeight - 4; y += 4) {
    for (int x = 4; x < kWidth - 4; x += 4) {
      const double z = camera.depth_m(a.depth[at(x, y)]);
      if (z == 0 || !calm(a, x, y)) continue;
      const Vec2 ray = camera.undistort({static_cast<double>(x), static_cast<double>(y)});
      const Vec3 p = T_b_a * Vec3{ray.x * z, ray.y * z, z};
      if (p.z < 0.3) continue;
      const Vec2 pixel = camera.project(p);
      const int u = static_cast<int>(std::lround(pixel.x)), v = static_cast<int>(std::lround(pixel.y));
      if (u < 3 || v < 3 || u >= kWidth - 3 || v >= kHeight - 3 || !calm(b, u, v)) continue;
      const double measured = camera.depth_m(b.depth[at(u, v)]);
      if (measured == 0) continue;
      ++result.compared;
      const double tolerance =
          0.015 + noise_sigmas * std::hypot(camera.depth_sigma_m(z), camera.depth_sigma_m(p.z));
      if (std::abs(p.z - measured) < tolerance) ++result.agree;
      if (p.z < measured - tolerance) ++result.seen_through;
    }
  }
  return result;
}

class EveryPath : public testing::TestWithParam<PathKind> {};
INSTANTIATE_TEST_SUITE_P(Paths, EveryPath,
                         testing::Values(PathKind::Orbit, PathKind::Walk, PathKind::Rotate));

TEST_P(EveryPath, DepthAgreesWithGroundTruth) {
  for (const bool noise : {false, true}) {
    SyntheticLog log({.seed = 3, .path = GetParam(), .noise = noise});
    SyntheticFrame a, b;
    log.render(10, a);
    log.render(25, b);
    const Agreement result = compare(a, b, noise ? 4 : 0);
    ASSERT_GT(result.compared, 2000);
    // A point may hide behind something in the other frame, but nothing is ever seen through.
    EXPECT_GT(result.agree, 0.95 * result.compared) << "noise " << noise;
    EXPECT_LT(result.seen_through, 0.003 * result.compared) << "noise " << noise;
  }
}

TEST_P(EveryPath, MovesLikeAHand) {
  const SyntheticLog log({.seed = 5, .path = GetParam()});
  double fastest_m_s = 0, fastest_rad_s = 0, way_m = 0, turned_rad = 0;
  for (int i = 0; i < 300; ++i) {
    const Pose step = inverse(log.T_world_camera(log.stamp_ns(i))) * log.T_world_camera(log.stamp_ns(i + 1));
    const double moved_m = norm(step.t), turn_rad = norm(log_so3(step.R));
    way_m += moved_m;
    turned_rad += turn_rad;
    fastest_m_s = std::max(fastest_m_s, 30 * moved_m);
    fastest_rad_s = std::max(fastest_rad_s, 30 * turn_rad);
  }
  EXPECT_GT(way_m, GetParam() == PathKind::Rotate ? 0.1 : 2.0);
  EXPECT_GT(turned_rad, 0.8);
  EXPECT_LT(fastest_m_s, 1.6);
  EXPECT_LT(fastest_rad_s, 2.5);
}

TEST_P(EveryPath, PeopleWalkThrough) {
  SyntheticLog log({.seed = 2, .people = 2, .path = GetParam()});
  SyntheticFrame frame;
  double most = 0;
  std::map<int, int> pixels_of;
  for (int i = 0; i < 210; i += 10) {
    log.render(i, frame);
    double people = 0;
    for (std::uint8_t k : frame.mask) {
      ASSERT_LE(k, 2);
      if (k == 0) continue;
      ++people;
      ++pixels_of[k];
    }
    most = std::max(most, people / (kWidth * kHeight));
  }
  EXPECT_GT(most, 0.03);
  EXPECT_LT(most, 0.6);
  EXPECT_GT(pixels_of[1], 5000);
  EXPECT_GT(pixels_of[2], 5000);
}

/// No plane that a ray runs along is where it ends.
TEST(RayCaster, ALevelRayEndsAtTheWall) {
  CameraModel camera;
  camera.width = 64, camera.height = 48;
  camera.fx = camera.fy = 50;
  camera.cx = 32, camera.cy = 24;
  RoomShell room;
  room.half_x = 3, room.half_y = 2, room.height = 2.5;
  const std::vector<Texture> none;
  RayCaster caster(camera, room, none);
  std::vector<float> depth_m(64 * 48);
  std::vector<std::uint8_t> figure(64 * 48);
  for (const double forward : {1.0, -1.0}) {
    Pose T_world_camera;
    T_world_camera.R.m = {0, 0, forward, -forward, 0, 0, 0, -1, 0};
    T_world_camera.t = {0, 0, 1};
    caster.look(T_world_camera, {}, 0, 0);
    caster.cast(depth_m, figure);
    EXPECT_EQ(depth_m[24 * 64 + 32], 3);
    for (const float z : depth_m) ASSERT_TRUE(z > 0 && z <= 3) << z;
  }
}

TEST(SyntheticLog, ShippedProfilesFitIt) {
  const std::string folder = STILLMAP_SOURCE_DIR "/firmware-config/";
  const std::vector<std::string> files{folder + "cameras/synthetic.toml", folder + "classes/vest.toml",
                                       folder + "demo.toml"};
  const Result<LoadedConfig> loaded = load_config(files, {});
  ASSERT_TRUE(loaded.ok()) << loaded.error().message;
  const CameraModel profile = loaded.value().config.camera, camera = SyntheticLog::camera();
  EXPECT_EQ(profile.width, camera.width);
  EXPECT_EQ(profile.height, camera.height);
  EXPECT_EQ(profile.fx, camera.fx);
  EXPECT_EQ(profile.fy, camera.fy);
  EXPECT_EQ(profile.cx, camera.cx);
  EXPECT_EQ(profile.cy, camera.cy);
  EXPECT_EQ(profile.depth_units_per_m, camera.depth_units_per_m);
  EXPECT_EQ(profile.depth_noise_m_at_1m, camera.depth_noise_m_at_1m);
  EXPECT_THAT(loaded.value().config.classes.names, testing::ElementsAre("person"));
  EXPECT_THAT(loaded.value().config.classes.dynamic, testing::ElementsAre("person"));
}

TEST(SyntheticLog, NobodyWithoutPeople) {
  SyntheticLog log({.people = 0});
  SyntheticFrame frame;
  log.render(20, frame);
  EXPECT_EQ(*std::max_element(frame.mask.begin(), frame.mask.end()), 0);
}

TEST(SyntheticLog, DepthNoiseIsThatOfTheCameraModel) {
  SyntheticLog log({.seed = 4, .people = 0});
  SyntheticFrame frame;
  log.render(0, frame);
  double sum_sq = 0;
  int count = 0, holes = 0;
  for (std::size_t i = 0; i < frame.depth.size(); ++i) {
    if (frame.depth[i] == 0) {
      ++holes;
      continue;
    }
    const double error = frame.depth[i] / 5000.0 - frame.true_depth_m[i];
    sum_sq += std::pow(error / SyntheticLog::camera().depth_sigma_m(frame.true_depth_m[i]), 2);
    ++count;
  }
  EXPECT_NEAR(std::sqrt(sum_sq / count), 1.0, 0.15);
  EXPECT_GT(holes, 0.005 * kWidth * kHeight);
  EXPECT_LT(holes, 0.25 * kWidth * kHeight);
}

TEST(SyntheticLog, IdealSensorHasNoHolesAndNoNoise) {
  SyntheticLog log({.seed = 4, .noise = false});
  SyntheticFrame frame;
  log.render(0, frame);
  for (std::size_t i = 0; i < frame.depth.size(); ++i) {
    ASSERT_NEAR(frame.depth[i] / 5000.0, frame.true_depth_m[i], 0.00011);
  }
}

/// A tracker needs contrast nearly everywhere, so every wall, board and floor has to have some.
TEST(SyntheticLog, PictureIsTexturedNearlyEverywhere) {
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    SyntheticLog log({.seed = seed, .people = 0});
    SyntheticFrame frame;
    log.render(0, frame);
    int textured = 0, cells = 0;
    for (int y0 = 0; y0 < kHeight; y0 += 40) {
      for (int x0 = 0; x0 < kWidth; x0 += 40) {
        int darkest = 255, brightest = 0;
        for (int i = 0; i < 1600; ++i) {
          const int green = frame.colour[at(x0 + i % 40, y0 + i / 40)].g;
          darkest = std::min(darkest, green);
          brightest = std::max(brightest, green);
        }
        ++cells;
        if (brightest - darkest > 40) ++textured;
      }
    }
    EXPECT_GT(textured, 0.8 * cells) << "seed " << seed;
  }
}

std::string bytes_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

std::map<std::string, std::string> files_of(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) files[fs::relative(entry.path(), folder).string()] = bytes_of(entry.path());
  }
  return files;
}

class WrittenLog : public testing::Test {
 protected:
  void SetUp() override { fs::remove_all(folder_); }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path write(const char* name, SyntheticOptions options) {
    options.frames = 2;
    const Status status = write_synthetic_log(options, folder_ / name);
    EXPECT_TRUE(status.ok()) << status.error().message;
    return folder_ / name;
  }
  fs::path folder_ =
      fs::path(testing::TempDir()) /
      (std::string("synthetic_log_") + testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST_F(WrittenLog, SameSeedSameBytesAndAnotherSeedDiffers) {
  const auto a = files_of(write("a", {.seed = 8})), again = files_of(write("again", {.seed = 8}));
  const auto other = files_of(write("other", {.seed = 9}));
  EXPECT_EQ(a.size(), 4u + 3u * 2u);
  EXPECT_TRUE(a == again);
  for (const auto& [name, bytes] : a) {
    if (name.ends_with(".txt") && name != "groundtruth.txt") continue;  // lists name the same stamps
    ASSERT_TRUE(other.contains(name));
    if (name.starts_with("mask")) continue;  // may be empty in both
    EXPECT_NE(bytes, other.at(name)) << name;
  }
}

TEST_F(WrittenLog, TextFilesFollowTheTumLayout) {
  const fs::path log = write("log", {.seed = 8});
  EXPECT_EQ(bytes_of(log / "associations.txt"),
            "1000.000000 rgb/1000.000000.jpg 1000.000000 depth/1000.000000.png\n"
            "1000.033333 rgb/1000.033333.jpg 1000.033333 depth/1000.033333.png\n");
  const SyntheticLog same({.seed = 8});
  std::ifstream in(log / "groundtruth.txt");
  std::string line;
  int poses = 0;
  while (std::getline(in, line)) {
    if (line.starts_with('#')) continue;
    std::istringstream fields(line);
    double stamp = 0;
    Vec3 t;
    Quaternion q;
    ASSERT_TRUE(fields >> stamp >> t.x >> t.y >> t.z >> q.x >> q.y >> q.z >> q.w) << line;
    const Pose truth = same.T_world_camera(static_cast<Nanoseconds>(std::llround(stamp * 1e6)) * 1000);
    EXPECT_LT(norm(truth.t - t), 1e-6);
    EXPECT_LT(norm(log_so3(transposed(truth.R) * rotation_from(q))), 1e-6);
    ++poses;
  }
  EXPECT_GE(poses, 7);  // 1/15 s at 100 Hz, and one before
}

TEST_F(WrittenLog, ALogIsNeverWrittenOverAnother) {
  const fs::path log = write("log", {});
  const Status status = write_synthetic_log({}, log);
  ASSERT_FALSE(status.ok());
  EXPECT_THAT(status.error().message, testing::HasSubstr("holds a log already"));
}

TEST_F(WrittenLog, SaysWhatCannotBeWritten) {
  fs::create_directories(folder_);
  std::ofstream(folder_ / "file") << "x";
  const Status status = write_synthetic_log({}, folder_ / "file");
  ASSERT_FALSE(status.ok());
  EXPECT_THAT(status.error().message, testing::HasSubstr((folder_ / "file").string()));
}

}  // namespace
}  // namespace stillmap::synthetic
