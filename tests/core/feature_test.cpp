// SPDX-License-Identifier: Apache-2.0
#include "core/feature.h"

#include <gtest/gtest.h>

namespace stillmap {
namespace {

TEST(Hamming, CountsDifferingBitsInEveryWord) {
  Descriptor a, b;
  EXPECT_EQ(hamming(a, b), 0);
  for (std::size_t word = 0; word < 4; ++word) {
    b.bits[word] = 1ULL << (63 - word);
    EXPECT_EQ(hamming(a, b), static_cast<int>(word) + 1);
  }
  a.bits.fill(~0ULL);
  EXPECT_EQ(hamming(a, {}), 256);
  EXPECT_EQ(hamming(a, b), 252);
}

}  // namespace
}  // namespace stillmap
