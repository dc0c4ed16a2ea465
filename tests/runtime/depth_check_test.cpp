// SPDX-License-Identifier: Apache-2.0
#include "runtime/depth_check.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "drivers/tum_log/tum_log.h"
#include "tests/support/frame.h"
#include "tests/support/shared_folder.h"

namespace stillmap {
namespace {

constexpr int kWidth = 320, kHeight = 240;

CameraModel camera(double units) {
  CameraModel c;
  c.width = kWidth, c.height = kHeight;
  c.depth_units_per_m = units;
  return c;
}

/// Dark posts at 1 m before a bright wall at 2 m, whose readings are `shift` px right of where they are seen.
test::Frame posts(int shift, double units = 1000) {
  test::Frame slot(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const auto is_post = [](int at) { return (at + 960) % 96 < 30; };
      slot.colour.at(x, y) = is_post(x) ? Bgr{40, 40, 40} : Bgr{180, 180, 180};
      slot.depth.at(x, y) = static_cast<std::uint16_t>((is_post(x - shift) ? 1 : 2) * units);
    }
  }
  return slot;
}

/// The verdict after a hundred such frames.
DepthCheck::Verdict verdict_on(const test::Frame& slot, double units = 1000) {
  DepthCheck check(camera(units));
  DepthCheck::Verdict last;
  for (int i = 0; i < 100; ++i) {
    const DepthCheck::Verdict v = check.look(slot);
    if (v.fault != DepthFault::None) last = v;
  }
  return last;
}

TEST(DepthCheck, SoundDepthIsNotBlamed) {
  for (const int shift : {0, 2, -2, 4, -4})
    EXPECT_EQ(verdict_on(posts(shift)).fault, DepthFault::None) << shift;
}

TEST(DepthCheck, EdgesBesideThoseOfColourAreUnregistered) {
  for (const int shift : {9, -14}) {
    const DepthCheck::Verdict v = verdict_on(posts(shift));
    EXPECT_EQ(v.fault, DepthFault::Unregistered) << shift;
    EXPECT_NEAR(v.amount, -shift, 3);
  }
}

TEST(DepthCheck, AWrongUnitIsAMatterOfScale) {
  const DepthCheck::Verdict v = verdict_on(posts(0, 5000), 100);
  EXPECT_EQ(v.fault, DepthFault::Scale);
  EXPECT_EQ(v.amount, 100);
  EXPECT_EQ(verdict_on(posts(0, 500), 5000).fault, DepthFault::Scale) << "0.1 m and 0.2 m";
  // A hall whose far end is beyond what is trusted is no wrong unit, until hardly anything else is seen.
  const auto hall = [](int far_percent) {
    test::Frame slot(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) slot.depth.at(x, y) = x * 100 < kWidth * far_percent ? 20'000 : 5000;
    }
    return slot;
  };
  EXPECT_EQ(verdict_on(hall(50)).fault, DepthFault::None);
  EXPECT_EQ(verdict_on(hall(70)).fault, DepthFault::Scale);
}

TEST(DepthCheck, AlmostNoReadingIsEmpty) {
  test::Frame slot = posts(0);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 20; x < kWidth; ++x) slot.depth.at(x, y) = 0;
  }
  const DepthCheck::Verdict v = verdict_on(slot);
  EXPECT_EQ(v.fault, DepthFault::Empty);
  EXPECT_GE(v.amount, 90);
}

TEST(DepthCheck, ARealLogIsSoundAndTheSameLogMovedIsNot) {
  STILLMAP_NEEDS_SHARED();
  CameraModel fr1 = camera(5000);
  fr1.width = 640, fr1.height = 480;
  TumLog log((test::shared_folder() / "data/fr1_rpy").string(), 640, 480);
  ASSERT_TRUE(log.open().ok());
  ASSERT_TRUE(log.start().ok());
  DepthCheck sound(fr1), moved(fr1);
  DepthFault verdict_on_sound = DepthFault::None;
  DepthCheck::Verdict verdict_on_moved;
  test::Frame slot(640, 480);
  for (int frames = 0; frames < 100;) {
    const GrabResult r = log.grab(slot, 0);
    ASSERT_NE(r.status, GrabStatus::EndOfStream);
    if (r.status != GrabStatus::Frame) continue;
    ++frames;
    if (const auto v = sound.look(slot); v.fault != DepthFault::None) verdict_on_sound = v.fault;
    for (int y = 0; y < 480; ++y) {
      std::uint16_t* row = slot.depth.row(y);
      std::copy_backward(row, row + 640 - 10, row + 640);
    }
    if (const auto v = moved.look(slot); v.fault != DepthFault::None) verdict_on_moved = v;
  }
  EXPECT_EQ(verdict_on_sound, DepthFault::None);
  EXPECT_EQ(verdict_on_moved.fault, DepthFault::Unregistered);
  EXPECT_NEAR(verdict_on_moved.amount, -10, 3);
}

}  // namespace
}  // namespace stillmap
