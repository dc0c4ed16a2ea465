// SPDX-License-Identifier: Apache-2.0
#include "core/halve.h"

#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "core/random.h"

namespace stillmap {
namespace {

TEST(HalveRow, EachPixelIsTheMeanOfFour) {
  Random random(3);
  for (const std::size_t width : {1U, 3U, 64U, 65U, 320U}) {
    std::vector<Bgr> upper(2 * width), lower(2 * width), out(width + 1, Bgr{9, 9, 9});
    for (std::vector<Bgr>* row : {&upper, &lower}) {
      for (Bgr& p : *row) {
        const std::uint64_t word = random.next();
        p = {static_cast<std::uint8_t>(word), static_cast<std::uint8_t>(word >> 8),
             static_cast<std::uint8_t>(word >> 16)};
      }
    }
    halve_row(upper.data(), lower.data(), std::span(out).first(width));
    for (std::size_t x = 0; x < width; ++x) {
      const std::array four{upper[2 * x], upper[2 * x + 1], lower[2 * x], lower[2 * x + 1]};
      int b = 2, g = 2, r = 2;
      for (const Bgr& p : four) {
        b += p.b;
        g += p.g;
        r += p.r;
      }
      ASSERT_EQ(out[x].b, b / 4) << width << " " << x;
      ASSERT_EQ(out[x].g, g / 4) << width << " " << x;
      ASSERT_EQ(out[x].r, r / 4) << width << " " << x;
    }
    EXPECT_EQ(out[width].b, 9) << "writes beyond the row";
  }
}

}  // namespace
}  // namespace stillmap
