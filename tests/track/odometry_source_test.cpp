// SPDX-License-Identifier: Apache-2.0
#include "track/odometry_source.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <thread>

#include "scene.h"

namespace stillmap {
namespace {

constexpr Nanoseconds kMs = 1'000'000;

/// A robot that drives a circle: at every moment where it is.
Pose driven(Nanoseconds stamp_ns) {
  const double t = to_seconds(stamp_ns);
  return {exp_so3({0, 0, 0.5 * t}), {std::sin(0.5 * t), 1 - std::cos(0.5 * t), 0}};
}
MotionDelta delta(Nanoseconds from_ns, Nanoseconds to_ns) {
  return {from_ns, to_ns, inverse(driven(from_ns)) * driven(to_ns), 0.003, 0.004};
}
void expect_motion(const std::optional<MotionDelta>& got, Nanoseconds from_ns, Nanoseconds to_ns,
                   double tolerance = 1e-9) {
  ASSERT_TRUE(got.has_value()) << from_ns << " to " << to_ns;
  const Pose want = inverse(driven(from_ns)) * driven(to_ns);
  EXPECT_LT(norm(got->T_from_to.t - want.t), tolerance) << from_ns << " to " << to_ns;
  EXPECT_LT(test::angle_between(got->T_from_to, want), tolerance);
}

TEST(OdometrySource, SaysNothingOfWhatItWasNotTold) {
  OdometrySource source;
  EXPECT_FALSE(source.between(0, kMs));
  ASSERT_TRUE(source.try_push(delta(100 * kMs, 120 * kMs)));
  EXPECT_FALSE(source.between(99 * kMs, 120 * kMs)) << "before its begin";
  EXPECT_TRUE(source.between(100 * kMs, 170 * kMs)) << "a little beyond its end";
  EXPECT_FALSE(source.between(100 * kMs, 171 * kMs)) << "far beyond its end";
}

TEST(OdometrySource, ChainsStepsForwardsBackwardsAndWithin) {
  OdometrySource source;
  for (int i = 0; i < 50; ++i) ASSERT_TRUE(source.try_push(delta(i * 20 * kMs, (i + 1) * 20 * kMs)));
  expect_motion(source.between(100 * kMs, 900 * kMs), 100 * kMs, 900 * kMs);
  expect_motion(source.between(900 * kMs, 100 * kMs), 900 * kMs, 100 * kMs);
  // Within a step and beyond the last one a robot is taken to go straight on: 20 ms of this circle are 10 mm.
  expect_motion(source.between(7 * kMs, 431 * kMs), 7 * kMs, 431 * kMs, 1e-4);
  expect_motion(source.between(0, 1030 * kMs), 0, 1030 * kMs, 1e-3);
  EXPECT_EQ(norm(source.between(500 * kMs, 500 * kMs)->T_from_to.t), 0);
}

TEST(OdometrySource, DoubtGrowsByTheRootOfTheSteps) {
  OdometrySource source;
  for (int i = 0; i < 16; ++i) ASSERT_TRUE(source.try_push(delta(i * 10 * kMs, (i + 1) * 10 * kMs)));
  const auto nine = source.between(30 * kMs, 120 * kMs), back = source.between(120 * kMs, 30 * kMs);
  ASSERT_TRUE(nine && back);
  EXPECT_NEAR(nine->sigma_rotation_rad, 3 * 0.003, 1e-12);
  EXPECT_NEAR(nine->sigma_translation_m, 3 * 0.004, 1e-12);
  EXPECT_EQ(back->sigma_translation_m, nine->sigma_translation_m);
}

TEST(OdometrySource, ABreakForgetsWhatWasBefore) {
  OdometrySource source;
  ASSERT_TRUE(source.try_push(delta(0, 20 * kMs)));
  ASSERT_TRUE(source.try_push(delta(30 * kMs, 50 * kMs)));
  EXPECT_FALSE(source.between(10 * kMs, 40 * kMs));
  expect_motion(source.between(30 * kMs, 50 * kMs), 30 * kMs, 50 * kMs);
}

TEST(OdometrySource, RemembersTheNewestStepsForHours) {
  OdometrySource source;
  constexpr int kSteps = 100'000;
  for (int i = 0; i < kSteps; ++i) {
    ASSERT_TRUE(source.try_push(delta(i * 10 * kMs, (i + 1) * 10 * kMs)));
    static_cast<void>(source.between(0, 0));
  }
  const Nanoseconds end = kSteps * 10 * kMs;
  expect_motion(source.between(end - 1000 * kMs, end), end - 1000 * kMs, end, 1e-6);
  EXPECT_FALSE(source.between(0, end));
}

TEST(OdometrySource, RefusesWhatIsNoMotion) {
  OdometrySource source;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  MotionDelta bad[6];
  for (MotionDelta& b : bad) b = delta(0, 20 * kMs);
  bad[0].to_ns = 0;
  bad[1].sigma_rotation_rad = 0;
  bad[2].sigma_translation_m = -1;
  bad[3].sigma_translation_m = nan;
  bad[4].T_from_to.t.y = nan;
  bad[5].T_from_to.R.m[3] = nan;
  for (const MotionDelta& b : bad) EXPECT_FALSE(source.try_push(b)) << &b - bad;
  for (int i = 0; i < 64; ++i) ASSERT_TRUE(source.try_push(delta(i * kMs, (i + 1) * kMs)));
  EXPECT_FALSE(source.try_push(delta(64 * kMs, 65 * kMs))) << "nobody asked for so long";
}

TEST(OdometrySource, OneThreadTellsWhileAnotherAsks) {
  OdometrySource source;
  constexpr Nanoseconds kEnd = 2000 * kMs;
  std::thread robot([&] {
    for (Nanoseconds at = 0; at < kEnd;) at += source.try_push(delta(at, at + kMs)) ? kMs : 0;
  });
  // Its end is known for sure when 50 ms beyond are.
  while (!source.between(kEnd - 100 * kMs, kEnd + 50 * kMs)) std::this_thread::yield();
  robot.join();
  expect_motion(source.between(kEnd - 100 * kMs, kEnd), kEnd - 100 * kMs, kEnd, 1e-6);
}

}  // namespace
}  // namespace stillmap
