// SPDX-License-Identifier: Apache-2.0
#include "stream/preview.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

namespace stillmap::stream {
namespace {

constexpr Box kBox{200, 100, 400, 400};

/// The message of a checkerboard's preview in which `own` and `scene` are known.
std::vector<std::uint8_t> picture(const Detections& own, const StreamScene& scene,
                                  const char* mode = "masked") {
  Config config;
  config.camera = {.width = 640, .height = 480, .fx = 500, .fy = 500, .cx = 320, .cy = 240};
  config.classes.names = {"person", "chair"};
  config.stream.preview = mode;
  Arena arena(16 << 20);
  Preview preview(arena, config);
  std::vector<Bgr> pixels(640 * 480);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const bool light = (i % 640 / 12 + i / 640 / 12) % 2 == 0;
    pixels[i] = light ? Bgr{250, 250, 250} : Bgr{5, 5, 5};
  }
  preview.shrink({pixels.data(), 640, 480, 640});
  std::vector<std::uint8_t> out(100'000);
  out.resize(preview.encode(5, own, scene, out));
  EXPECT_GT(out.size(), 1000u);
  return out;
}

Detections found(std::uint16_t class_id, ClassKind kind) {
  Detections own;
  EXPECT_TRUE(own.items.try_push_back({.box = kBox, .class_id = class_id, .kind = kind}));
  return own;
}

StreamScene carried(std::uint16_t class_id, ClassKind kind) {
  StreamScene scene;
  EXPECT_TRUE(scene.objects.try_push_back({.class_id = class_id, .kind = kind, .box = kBox}));
  return scene;
}

TEST(Preview, HidesAPersonWhomTheDetectorFoundOrTheTrackerCarried) {
  const auto plain = picture({}, {});
  const auto hidden = picture(found(0, ClassKind::Dynamic), {});
  EXPECT_LT(hidden.size(), 0.9 * static_cast<double>(plain.size())) << "a pixelated part is coded in less";
  EXPECT_EQ(picture({}, carried(0, ClassKind::Dynamic)), hidden);
  EXPECT_EQ(picture(found(0, ClassKind::Ignored), {}), hidden) << "a person, whatever the table says";
  EXPECT_EQ(picture(found(1, ClassKind::Dynamic), {}), hidden) << "what moves may be a person";
  EXPECT_EQ(picture(found(1, ClassKind::SemiStatic), carried(1, ClassKind::Static)), plain);
  EXPECT_EQ(picture(found(0, ClassKind::Dynamic), {}, "full"), plain);
}

TEST(Preview, HidesAroundAFeatureThatMoves) {
  const auto plain = picture({}, {});
  StreamScene scene;
  ASSERT_TRUE(scene.features.try_push_back({300, 200, Label::Static}));
  EXPECT_EQ(picture({}, scene), plain);
  ASSERT_TRUE(scene.features.try_push_back({300, 200, Label::Dynamic}));
  EXPECT_NE(picture({}, scene), plain);
}

}  // namespace
}  // namespace stillmap::stream
