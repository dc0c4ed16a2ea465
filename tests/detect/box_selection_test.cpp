// SPDX-License-Identifier: Apache-2.0
#include "detect/box_selection.h"

#include <gtest/gtest.h>

#include <limits>

namespace stillmap {
namespace {

TEST(IntersectionOverUnion, OfKnownBoxes) {
  const Box a{0, 0, 10, 10};
  EXPECT_FLOAT_EQ(intersection_over_union(a, a), 1);
  EXPECT_FLOAT_EQ(intersection_over_union(a, {5, 0, 15, 10}), 50.f / 150.f);
  EXPECT_EQ(intersection_over_union(a, {10, 0, 20, 10}), 0);
  EXPECT_EQ(intersection_over_union({}, {}), 0);
}

TEST(BoxSelection, LeavesOutWhatIsNoBoxInThePicture) {
  const std::vector<ClassKind> kinds(1, ClassKind::Dynamic);
  BoxSelection boxes(Letterbox(640, 480, 320, 256), kinds, 0.6);
  FixedVector<Detection, 64> found;
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), -1.f / 0.f}) {
    boxes.add({bad, 20, 40, 40}, 0, 0.9f);
    boxes.add({20, 20, 40, bad}, 0, 0.9f);
  }
  boxes.add({40, 40, 20, 20}, 0, 0.9f);
  boxes.add({20, 0, 40, 8}, 0, 0.9f);  // within the upper bar
  boxes.select(found);
  EXPECT_TRUE(found.empty());
  boxes.add({20, 0, 40, 9}, 0, 0.9f);
  boxes.select(found);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_FLOAT_EQ(found[0].box.y1, 2);
  boxes.clear();
  boxes.select(found);
  EXPECT_TRUE(found.empty());
}

}  // namespace
}  // namespace stillmap
