// SPDX-License-Identifier: Apache-2.0
#include "core/image.h"

#include <gtest/gtest.h>

#include <array>

namespace stillmap {
namespace {

TEST(ImageView, StrideCountsPixels) {
  std::array<std::uint16_t, 12> pixels{};
  const ImageView<std::uint16_t> view{pixels.data(), 3, 3, 4};
  view.at(2, 1) = 7;
  EXPECT_EQ(pixels[6], 7);
  EXPECT_EQ(view.row(2), pixels.data() + 8);
  const ImageView<const std::uint16_t> reading = view;
  EXPECT_EQ(reading.at(2, 1), 7);
}

TEST(ImageView, ContainsIsHalfOpen) {
  const ImageView<std::uint8_t> view{nullptr, 3, 2, 3};
  EXPECT_TRUE(view.contains(0, 0));
  EXPECT_TRUE(view.contains(2, 1));
  EXPECT_FALSE(view.contains(3, 1));
  EXPECT_FALSE(view.contains(2, 2));
  EXPECT_FALSE(view.contains(-1, 0));
  EXPECT_FALSE(view.contains(0, -1));
}

}  // namespace
}  // namespace stillmap
