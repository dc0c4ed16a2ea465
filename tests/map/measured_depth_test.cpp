// SPDX-License-Identifier: Apache-2.0
#include "map/measured_depth.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>
#include <vector>

#include "map_scene.h"

namespace stillmap {
namespace {

struct DepthUnderTest {
  CameraModel camera = test::small_camera();
  Arena arena{1 << 20};
  MeasuredDepth measured{arena, camera, 4.5};
  std::vector<std::uint16_t> depth = std::vector<std::uint16_t>(160 * 120, 10000);  // 2 m
  DynamicMask mask;

  void prepare() { measured.prepare({depth.data(), 160, 120, 160}, mask); }
  float at(int x, int y) const { return measured.z_m()[static_cast<std::size_t>(y * 160 + x)]; }
  std::uint16_t& raw(int x, int y) { return depth[static_cast<std::size_t>(y * 160 + x)]; }
};

TEST(MeasuredDepth, is_the_reading_in_metres) {
  DepthUnderTest t;
  t.prepare();
  EXPECT_FLOAT_EQ(t.at(80, 60), 2);
  for (const auto& [x, y] : {std::pair(0, 0), {159, 0}, {0, 119}, {159, 119}}) EXPECT_FLOAT_EQ(t.at(x, y), 2);
}

TEST(MeasuredDepth, far_readings_only_free_the_ray_and_untrusted_ones_say_nothing) {
  DepthUnderTest t;
  std::fill(t.depth.begin(), t.depth.end(), std::uint16_t{25000});
  t.prepare();
  EXPECT_FLOAT_EQ(t.at(80, 60), -5);
  for (const int raw : {0, 1000 /* 0.2 m */, 41000 /* 8.2 m */, 65535}) {
    std::fill(t.depth.begin(), t.depth.end(), static_cast<std::uint16_t>(raw));
    t.prepare();
    EXPECT_EQ(t.at(80, 60), 0) << raw;
  }
}

TEST(MeasuredDepth, silhouettes_only_free_the_ray_up_to_the_nearer_side) {
  DepthUnderTest t;
  for (int y = 0; y < 120; ++y) {
    for (int x = 80; x < 160; ++x) t.raw(x, y) = 10600;  // 6 % farther
  }
  t.prepare();
  EXPECT_GT(t.at(78, 60), 0);
  EXPECT_FLOAT_EQ(t.at(79, 60), -2);
  EXPECT_FLOAT_EQ(t.at(80, 60), -2);
  EXPECT_GT(t.at(81, 60), 0);
}

TEST(MeasuredDepth, a_slope_and_a_hole_are_no_silhouette) {
  DepthUnderTest t;
  for (int y = 0; y < 120; ++y) {
    for (int x = 0; x < 160; ++x) t.raw(x, y) = static_cast<std::uint16_t>(10000 + 300 * (x % 2));  // 3 %
  }
  t.raw(80, 60) = 0;
  t.prepare();
  EXPECT_EQ(t.at(80, 60), 0);
  EXPECT_GT(t.at(81, 60), 0);
  EXPECT_GT(t.at(80, 61), 0);
}

/// Boxes and cells of all kinds, with depth on both sides of the cells' intervals.
void fill_scene(DepthUnderTest& t, std::mt19937& random) {
  for (std::uint16_t& raw : t.depth) raw = static_cast<std::uint16_t>(10000 + random() % 480);
  t.mask.boxes.items.clear();
  const std::array<ClassKind, 4> kinds{ClassKind::Ignored, ClassKind::Static, ClassKind::SemiStatic,
                                       ClassKind::Dynamic};
  for (int i = 0; i < 12; ++i) {
    const auto real = [&](double to) {
      return static_cast<float>(static_cast<double>(random() % 10000) / 10000 * to);
    };
    const float x = real(180) - 20, y = real(140) - 20;
    ASSERT_TRUE(
        t.mask.boxes.items.try_push_back({{x, y, x + real(40), y + real(40)}, 0, kinds[random() % 4], 1}));
  }
  t.mask.cell_px = 8;
  t.mask.columns = 20;
  t.mask.rows = 15;
  for (DynamicMask::Cell& cell : t.mask.cells) {
    cell.label = std::array{Label::Static, Label::Dynamic, Label::SemiStatic}[random() % 3];
    cell.near_mm = static_cast<std::uint16_t>(1990 + random() % 50);
    cell.far_mm = static_cast<std::uint16_t>(cell.near_mm + random() % 60);
  }
}

bool in_dynamic_box(const DynamicMask& mask, int x, int y) {
  return std::ranges::any_of(mask.boxes.items, [&](const Detection& d) {
    return d.kind == ClassKind::Dynamic && d.box.contains(x, y);
  });
}

TEST(MeasuredDepth, leaves_out_exactly_what_the_mask_leaves_out) {
  std::mt19937 random(7);
  for (const DynamicRule rule : {DynamicRule::Off, DynamicRule::Paper, DynamicRule::Silhouette}) {
    DepthUnderTest t;
    int left_out = 0;
    for (int round = 0; round < 10; ++round) {
      fill_scene(t, random);
      t.mask.rule = rule;
      t.prepare();
      for (int y = 0; y < 120; ++y) {
        for (int x = 0; x < 160; ++x) {
          const bool out = rule == DynamicRule::Paper
                               ? in_dynamic_box(t.mask, x, y)
                               : label_at(t.mask, x, y, t.camera.depth_m(t.raw(x, y))) == Label::Dynamic;
          left_out += out;
          ASSERT_EQ(t.at(x, y) < 0, out) << x << " " << y;
          ASSERT_NEAR(std::abs(t.at(x, y)), t.raw(x, y) / 5000.0, 1e-4);
        }
      }
    }
    EXPECT_EQ(left_out > 0, rule != DynamicRule::Off);
  }
}

TEST(MeasuredDepth, senseless_boxes_do_no_harm) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(),
                  kHuge = std::numeric_limits<float>::infinity();
  DepthUnderTest t;
  t.mask.rule = DynamicRule::Paper;
  for (const Box& box :
       {Box{kNan, 0, 10, 10}, Box{0, kNan, 10, kNan}, Box{50, 50, 40, 40}, Box{-kHuge, 100, 1, kHuge}}) {
    ASSERT_TRUE(t.mask.boxes.items.try_push_back({box, 0, ClassKind::Dynamic, 1}));
  }
  t.prepare();
  EXPECT_GT(t.at(45, 45), 0);
  EXPECT_GT(t.at(5, 5), 0);
}

}  // namespace
}  // namespace stillmap
