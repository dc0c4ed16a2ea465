// SPDX-License-Identifier: Apache-2.0
#include "scene.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace stillmap {
namespace {

/// Read from what another test, or another build's, has rendered, it is what would be rendered here.
TEST(Scene, IsTheSameReadAndRendered) {
  for (const int people : {0, 2}) {
    synthetic::SyntheticLog log({.seed = 2, .people = people});
    synthetic::SyntheticFrame rendered;
    log.render(50, rendered);
    static_cast<void>(test::Scene(log, 50));
    const synthetic::SyntheticFrame read = test::Scene(log, 50).truth;
    EXPECT_EQ(read.stamp_ns, rendered.stamp_ns);
    EXPECT_EQ(norm(read.T_world_camera.t - rendered.T_world_camera.t), 0);
    EXPECT_TRUE(std::ranges::equal(read.colour, rendered.colour,
                                   [](Bgr a, Bgr b) { return a.b == b.b && a.g == b.g && a.r == b.r; }));
    EXPECT_TRUE(read.depth == rendered.depth);
    EXPECT_TRUE(read.mask == rendered.mask);
    EXPECT_TRUE(people == 0 || read.true_depth_m == rendered.true_depth_m);
  }
}

}  // namespace
}  // namespace stillmap
