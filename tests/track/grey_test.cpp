// SPDX-License-Identifier: Apache-2.0
#include "track/grey.h"

#include <gtest/gtest.h>

#include <vector>

namespace stillmap {
namespace {

TEST(MakeGrey, IsBt601WithinOneLevelOnEveryColour) {
  std::vector<Bgr> colour;
  for (int b = 0; b < 256; b += 5) {
    for (int g = 0; g < 256; g += 5) {
      for (int r = 0; r < 256; r += 5) {
        colour.push_back(
            {static_cast<std::uint8_t>(b), static_cast<std::uint8_t>(g), static_cast<std::uint8_t>(r)});
      }
    }
  }
  const int n = static_cast<int>(colour.size());
  std::vector<std::uint8_t> grey(colour.size());
  make_grey(ImageView<const Bgr>{colour.data(), n, 1, n}, ImageView<std::uint8_t>{grey.data(), n, 1, n});
  for (std::size_t i = 0; i < colour.size(); ++i) {
    const double luma = 0.114 * colour[i].b + 0.587 * colour[i].g + 0.299 * colour[i].r;
    ASSERT_NEAR(grey[i], luma, 1.0) << int{colour[i].b} << " " << int{colour[i].g} << " " << int{colour[i].r};
  }
  EXPECT_EQ(grey.front(), 0);
  EXPECT_EQ(grey.back(), 255);
}

TEST(MakeGrey, KeepsWithinTheRowsOfAWiderPicture) {
  std::vector<Bgr> colour(30, Bgr{200, 200, 200});
  std::vector<std::uint8_t> grey(30, 7);
  make_grey(ImageView<const Bgr>{colour.data(), 4, 3, 10}, ImageView<std::uint8_t>{grey.data(), 4, 3, 10});
  for (std::size_t i = 0; i < grey.size(); ++i) EXPECT_EQ(grey[i], i % 10 < 4 ? 200 : 7) << i;
}

}  // namespace
}  // namespace stillmap
