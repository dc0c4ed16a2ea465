// SPDX-License-Identifier: Apache-2.0
#include "detect/box_carrier.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/support/read_image.h"

namespace stillmap {
namespace {

constexpr Nanoseconds kMs = 1'000'000;
constexpr double kGrowth_per_s = 0.4;

CameraModel camera_model() {
  CameraModel camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 525;
  camera.cx = 319.5;
  camera.cy = 239.5;
  return camera;
}

/// A board that faces the first camera: where it stands in odom (in the middle of its plane) and half its
/// size.
struct Board {
  Vec3 centre{0, 0, 2};
  double half_width_m = 0.3, half_height_m = 0.5;
};

class BoxCarrierTest : public testing::Test {
 protected:
  /// The board's outline in a picture taken at T_odom_camera, `grow` larger on either side.
  Box outline(const Board& b, const Pose& T_odom_camera, double grow = 0) const {
    Box box{1e9f, 1e9f, -1e9f, -1e9f};
    for (const double sx : {-1.0, 1.0}) {
      for (const double sy : {-1.0, 1.0}) {
        const Vec3 corner = b.centre + Vec3{sx * b.half_width_m, sy * b.half_height_m, 0};
        const Vec2 p = camera_.project(inverse(T_odom_camera) * corner);
        const auto x = static_cast<float>(p.x), y = static_cast<float>(p.y);
        box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x), std::max(box.y1, y)};
      }
    }
    const auto gx = static_cast<float>(grow) * box.width() / 2,
               gy = static_cast<float>(grow) * box.height() / 2;
    return {box.x0 - gx, box.y0 - gy, box.x1 + gx, box.y1 + gy};
  }
  Detection seen(const Board& b, const Pose& T_odom_camera = {}, std::uint16_t class_id = 0) const {
    const Vec3 p = inverse(T_odom_camera) * b.centre;
    return {outline(b, T_odom_camera), class_id, ClassKind::Dynamic, 0.8f, static_cast<float>(p.z)};
  }
  void update(Nanoseconds stamp_ns, const std::vector<Detection>& found, const Pose& T_odom_camera = {}) {
    Detections d;
    d.stamp_ns = stamp_ns;
    for (const Detection& f : found) ASSERT_TRUE(d.items.try_push_back(f));
    carrier_.update(d, T_odom_camera);
  }
  std::vector<Detection> carry(Nanoseconds stamp_ns, const Pose& T_odom_camera = {}) {
    Detections out;
    carrier_.carry(stamp_ns, T_odom_camera, out);
    EXPECT_EQ(out.stamp_ns, stamp_ns);
    return {out.items.begin(), out.items.end()};
  }
  static void expect_box(const Box& a, const Box& b, float tolerance = 0.05f) {
    EXPECT_NEAR(a.x0, b.x0, tolerance);
    EXPECT_NEAR(a.y0, b.y0, tolerance);
    EXPECT_NEAR(a.x1, b.x1, tolerance);
    EXPECT_NEAR(a.y1, b.y1, tolerance);
  }
  static double centre_x(const Detection& d) { return (d.box.x0 + d.box.x1) / 2; }
  /// Where a board that has come `x_m` to the right appears.
  double column_of(double x_m) const { return camera_.cx + camera_.fx * x_m / 2; }

  CameraModel camera_ = camera_model();
  BoxCarrier carrier_{camera_, Config{}.detector};
};

TEST_F(BoxCarrierTest, NothingFromNothing) {
  EXPECT_TRUE(carry(0).empty());
}

TEST_F(BoxCarrierTest, ItsOwnFrameGetsItsBoxUnchanged) {
  const Detection d = seen({{0.2, 0.1, 2}});
  update(100 * kMs, {d});
  const auto out = carry(100 * kMs);
  ASSERT_EQ(out.size(), 1u);
  EXPECT_EQ(out[0].box.x0, d.box.x0);
  EXPECT_EQ(out[0].box.y1, d.box.y1);
  EXPECT_EQ(out[0].depth_m, d.depth_m);
  EXPECT_EQ(out[0].score, d.score);
  EXPECT_EQ(out[0].kind, ClassKind::Dynamic);
}

/// The camera turns and walks on; the thing stands: the box lands where the thing is.
TEST_F(BoxCarrierTest, AStandingThingIsFoundByAMovingCamera) {
  const Pose poses[] = {{exp_so3({0, 0.1, 0}), {}},
                        {exp_so3({0.08, 0, 0}), {}},
                        {Mat3{}, {0.2, -0.1, 0}},
                        {Mat3{}, {0, 0, 0.5}},
                        {exp_so3({0.05, -0.08, 0.1}), {0.1, 0.05, -0.2}}};
  const Board board{{0.1, 0, 2}, 0.2, 0.3};
  for (const Pose& T_odom_camera : poses) {
    carrier_.clear();
    update(0, {seen(board)});
    const auto out = carry(100 * kMs, T_odom_camera);
    ASSERT_EQ(out.size(), 1u);
    expect_box(out[0].box, outline(board, T_odom_camera, 0.1 * kGrowth_per_s));
    EXPECT_NEAR(out[0].depth_m, (inverse(T_odom_camera) * board.centre).z, 1e-3);
  }
}

TEST_F(BoxCarrierTest, TheFirstCameraNeedNotBeAtTheOrigin) {
  const Pose T_first{Mat3{}, {1, 2, -1}};
  const Board board{{1.1, 2, 2}, 0.2, 0.3};
  update(0, {seen(board, T_first)}, T_first);
  const Pose T_then{Mat3{}, {1.2, 2, -0.5}};
  const auto out = carry(50 * kMs, T_then);
  ASSERT_EQ(out.size(), 1u);
  expect_box(out[0].box, outline(board, T_then, 0.05 * kGrowth_per_s));
}

TEST_F(BoxCarrierTest, AWalkerIsCarriedOnWithHisSpeed) {
  // 1 m/s to the right: half of it is believed at the first look, then the mean of old and new.
  update(0, {seen({{0, 0, 2}})});
  EXPECT_NEAR(centre_x(carry(100 * kMs)[0]), column_of(0), 0.1) << "one look tells no speed";
  update(100 * kMs, {seen({{0.1, 0, 2}})});
  EXPECT_NEAR(centre_x(carry(200 * kMs)[0]), column_of(0.1 + 0.05), 0.1);
  update(200 * kMs, {seen({{0.2, 0, 2}})});
  EXPECT_NEAR(centre_x(carry(300 * kMs)[0]), column_of(0.2 + 0.075), 0.1);
  EXPECT_EQ(carry(300 * kMs).size(), 1u) << "three looks at one thing";
}

TEST_F(BoxCarrierTest, SpeedIsMeasuredInTheRoomNotInThePicture) {
  // The thing stands, the camera moves: no speed.
  const Board board{{0, 0, 2}};
  for (int i = 0; i < 5; ++i) {
    const Pose T{exp_so3({0, 0.03 * i, 0}), {0.05 * i, 0, 0}};
    update(i * 100 * kMs, {seen(board, T)}, T);
  }
  const Pose T_last{exp_so3({0, 0.12, 0}), {0.2, 0, 0}};
  const auto out = carry(700 * kMs, T_last);
  ASSERT_EQ(out.size(), 1u);
  const Box expected = outline(board, T_last);
  EXPECT_NEAR(centre_x(out[0]), (expected.x0 + expected.x1) / 2, 6);
}

TEST_F(BoxCarrierTest, AnObjectKeepsItsNumberAndGetsOlder) {
  update(0, {seen({.centre = {0, 0, 2}}), seen({.centre = {1, 0.3, 2}})});
  update(100 * kMs, {seen({.centre = {0.1, 0, 2}})});
  const auto carried = carry(200 * kMs);
  ASSERT_EQ(carried.size(), 2u);
  EXPECT_EQ(carried[0].object, 1u);
  EXPECT_EQ(carried[1].object, 2u);
  EXPECT_EQ(carried[0].age_ns, 200 * kMs);
  EXPECT_GT(carried[0].velocity_m_s.x, 0.4);
  carrier_.clear();
  update(300 * kMs, {seen({.centre = {0, 0, 2}})});
  EXPECT_EQ(carry(300 * kMs)[0].object, 3u);
}

TEST_F(BoxCarrierTest, SpeedHasALimit) {
  update(0, {seen({{0, 0, 2}})});
  update(100 * kMs, {seen({{0.7, 0, 2}})});  // 7 m/s: two people, or a mistake
  EXPECT_NEAR(centre_x(carry(200 * kMs)[0]), column_of(0.7 + 0.5 * 0.25), 0.2);
}

TEST_F(BoxCarrierTest, CoastingEnds) {
  update(0, {seen({{-0.5, 0, 2}})});
  update(100 * kMs, {seen({{-0.4, 0, 2}})});  // believed: 0.5 m/s
  EXPECT_NEAR(centre_x(carry(450 * kMs)[0]), column_of(-0.4 + 0.175), 0.2);
  EXPECT_NEAR(centre_x(carry(750 * kMs)[0]), column_of(-0.4 + 0.175), 0.2) << "no farther";
  EXPECT_EQ(carry(800 * kMs).size(), 1u) << "700 ms old";
  EXPECT_TRUE(carry(801 * kMs).empty());
  EXPECT_TRUE(carry(300 * kMs).empty()) << "gone for good";
}

TEST_F(BoxCarrierTest, BoxesGrowWithTheirAge) {
  update(0, {seen({})});
  const float before = carry(0)[0].box.width();
  EXPECT_NEAR(carry(250 * kMs)[0].box.width(), before * 1.1f, 0.1f);
  EXPECT_NEAR(carry(500 * kMs)[0].box.width(), before * 1.2f, 0.1f);
}

TEST_F(BoxCarrierTest, TwoMissesAreForgivenAThirdIsNot) {
  update(0, {seen({})});
  update(50 * kMs, {seen({})});
  update(100 * kMs, {});
  update(200 * kMs, {});
  EXPECT_EQ(carry(200 * kMs).size(), 1u);
  update(300 * kMs, {seen({})});  // found again: the count begins anew
  update(400 * kMs, {});
  update(500 * kMs, {});
  EXPECT_EQ(carry(500 * kMs).size(), 1u);
  update(600 * kMs, {});
  EXPECT_TRUE(carry(600 * kMs).empty());
}

/// The default counts from 0.4 on, and a look fades by 0.7.
TEST_F(BoxCarrierTest, WhatIsFoundWeaklyCountsWhenItIsFoundAgain) {
  Detection weak = seen({});
  weak.score = 0.28f;
  update(0, {weak});
  EXPECT_TRUE(carry(0).empty());
  update(100 * kMs, {weak});  // 0.28 + 0.7 * 0.28 = 0.476
  ASSERT_EQ(carry(100 * kMs).size(), 1u);
  EXPECT_EQ(carry(100 * kMs)[0].age_ns, 100 * kMs) << "it was there all along";
  update(200 * kMs, {});
  EXPECT_TRUE(carry(200 * kMs).empty()) << "not sure enough for a miss";
  update(300 * kMs, {weak});  // 0.28 + 0.7^2 * 0.476 = 0.513
  EXPECT_EQ(carry(300 * kMs).size(), 1u);
}

TEST_F(BoxCarrierTest, WhatIsFoundWeaklyHereAndThereIsNothing) {
  for (int i = 0; i < 6; ++i) {
    Detection weak = seen({{i % 2 == 0 ? -0.5 : 0.5, 0, 2.0 + i}});
    weak.score = 0.39f;
    update(i * 100 * kMs, {weak});
    EXPECT_TRUE(carry(i * 100 * kMs).empty()) << i;
  }
}

TEST_F(BoxCarrierTest, AMissOfOneIsNotAMissOfTheOther) {
  const Board left{{-0.9, 0, 2}}, right{{0.9, 0, 2}};
  update(0, {seen(left), seen(right)});
  for (int i = 1; i <= 3; ++i) update(i * 100 * kMs, {seen(right)});
  const auto out = carry(300 * kMs);
  ASSERT_EQ(out.size(), 1u);
  EXPECT_GT(centre_x(out[0]), 320);
}

TEST_F(BoxCarrierTest, ThingsApartOrOfOtherClassesAreNotOne) {
  update(0, {seen({{-0.5, 0, 2}}), seen({{0.5, 0, 2}})});
  EXPECT_EQ(carry(0).size(), 2u) << "a metre apart";
  update(100 * kMs, {seen({{-0.45, 0, 2}}), seen({{0.55, 0, 2}})});
  EXPECT_EQ(carry(100 * kMs).size(), 2u);
  carrier_.clear();
  update(0, {seen({}, {}, 1)});
  update(100 * kMs, {seen({}, {}, 2)});
  EXPECT_EQ(carry(100 * kMs).size(), 2u) << "two classes";
  carrier_.clear();
  update(0, {seen({{0, 0, 2}})});
  update(100 * kMs, {seen({{0, 0, 3.5}})});
  EXPECT_EQ(carry(100 * kMs).size(), 2u) << "one behind the other";
}

TEST_F(BoxCarrierTest, BehindTheCameraThereIsNoBox) {
  update(0, {seen({})});
  EXPECT_TRUE(carry(50 * kMs, {exp_so3({0, 3.1, 0}), {}}).empty());
  EXPECT_TRUE(carry(60 * kMs, {Mat3{}, {0, 0, 2.5}}).empty()) << "walked past it";
  EXPECT_EQ(carry(100 * kMs).size(), 1u) << "and turned back";
}

TEST_F(BoxCarrierTest, OutsideThePictureThereIsNoBoxAndAtItsRimAPart) {
  update(0, {seen({})});
  EXPECT_TRUE(carry(50 * kMs, {exp_so3({0, 1, 0}), {}}).empty());
  const auto out = carry(60 * kMs, {exp_so3({0, 0.55, 0}), {}});
  ASSERT_EQ(out.size(), 1u);
  EXPECT_EQ(out[0].box.x0, 0);
  EXPECT_GT(out[0].box.x1, 1);
  EXPECT_GE(out[0].box.y0, 0);
  EXPECT_LE(out[0].box.y1, 480);
}

TEST_F(BoxCarrierTest, WithoutDepthItStandsAtAGuessAndSaysSo) {
  Detection d = seen({{0.2, 0, 2.5}});
  d.depth_m = 0;
  update(0, {d});
  const Pose T{Mat3{}, {0.1, 0, 0}};
  const auto out = carry(50 * kMs, T);
  ASSERT_EQ(out.size(), 1u);
  EXPECT_EQ(out[0].depth_m, 0);
  expect_box(out[0].box, outline({{0.2, 0, 2.5}}, T, 0.05 * kGrowth_per_s));
}

TEST_F(BoxCarrierTest, ClearForgetsAll) {
  update(0, {seen({{0, 0, 2}})});
  update(100 * kMs, {seen({{0.1, 0, 2}})});
  carrier_.clear();
  EXPECT_TRUE(carry(100 * kMs).empty());
  update(200 * kMs, {seen({{0.2, 0, 2}})});
  EXPECT_NEAR(centre_x(carry(300 * kMs)[0]), column_of(0.2), 0.1) << "its speed too";
}

TEST_F(BoxCarrierTest, MoreThanItHoldsIsNoHarm) {
  for (std::uint16_t look = 0; look < 4; ++look) {  // each of another class: nothing is found again
    std::vector<Detection> crowd;
    for (int i = 0; i < 64; ++i)
      crowd.push_back(seen({{0, 0, 1.0 + i}, 0.02 * (1 + i), 0.02 * (1 + i)}, {}, look));
    update(look * kMs, crowd);
    const auto out = carry(look * kMs);
    ASSERT_EQ(out.size(), 64u);
    EXPECT_EQ(out[0].class_id, look < 2 ? 0 : look - 1) << "what was found first, while it is sure";
  }
}

TEST_F(BoxCarrierTest, OddBoxesGiveNoNonsense) {
  for (const Box box : {Box{100, 100, 100, 100}, Box{0, 0, 640, 480}, Box{-500, -500, 2000, 2000}}) {
    carrier_.clear();
    update(0, {{box, 0, ClassKind::Dynamic, 0.5f, 2}});
    for (const Detection& d : carry(100 * kMs, {exp_so3({0, 0.2, 0}), {0.1, 0, 0}})) {
      EXPECT_GE(d.box.x0, 0);
      EXPECT_GE(d.box.y0, 0);
      EXPECT_LE(d.box.x1, 640);
      EXPECT_LE(d.box.y1, 480);
      EXPECT_GT(d.box.area(), 0);
    }
  }
}

class MeasureDepths : public testing::Test {
 protected:
  double depth_of(const Box& box) {
    Detections d;
    EXPECT_TRUE(d.items.try_push_back({box, 0, ClassKind::Dynamic, 0.5f, 9}));
    measure_depths(d, picture_.view(), camera_model());
    return d.items[0].depth_m;
  }
  void fill(int x0, int y0, int x1, int y1, int mm) {
    for (int y = y0; y < y1; ++y) {
      std::fill(picture_.view().row(y) + x0, picture_.view().row(y) + x1, static_cast<std::uint16_t>(mm));
    }
  }
  test::Image<std::uint16_t> picture_{640, 480, 3000};
};

TEST_F(MeasureDepths, ReadsTheNearerPartOfTheMiddle) {
  fill(250, 180, 350, 300, 1500);  // somebody before the wall, in half of the middle
  EXPECT_NEAR(depth_of({200, 120, 400, 360}), 1.5, 1e-3);
  fill(200, 120, 400, 150, 700);  // something near in the outer quarter does not count
  EXPECT_NEAR(depth_of({200, 120, 400, 360}), 1.5, 1e-3);
}

TEST_F(MeasureDepths, LooksThroughHoles) {
  fill(200, 120, 400, 360, 0);
  EXPECT_EQ(depth_of({200, 120, 400, 360}), 0);
  fill(260, 180, 300, 300, 2000);
  EXPECT_NEAR(depth_of({200, 120, 400, 360}), 2, 1e-3);
}

TEST_F(MeasureDepths, BoxesBeyondThePictureAreRead) {
  EXPECT_NEAR(depth_of({-100, -100, 200, 200}), 3, 1e-3);
  EXPECT_EQ(depth_of({700, 500, 900, 700}), 0);
  EXPECT_NEAR(depth_of({300, 200, 300, 200}), 3, 1e-3) << "one pixel, many times";
}

}  // namespace
}  // namespace stillmap
