// SPDX-License-Identifier: Apache-2.0
#include "core/dynamic_mask.h"

#include <gtest/gtest.h>

namespace stillmap {
namespace {

constexpr double kX = 100, kY = 100;

Detection box(ClassKind kind, Box b = {90, 90, 110, 110}) {
  return {b, 0, kind, 0.9F};
}

/// The seed paper's Table 2, written down by hand: what a point inside these boxes is.
struct Row {
  bool in_dynamic, in_semi_static, in_static;
  Label label;
};
constexpr std::array<Row, 8> kTable2{{{false, false, false, Label::Static},
                                      {false, false, true, Label::Static},
                                      {false, true, false, Label::SemiStatic},
                                      {false, true, true, Label::Static},
                                      {true, false, false, Label::Dynamic},
                                      {true, false, true, Label::Static},
                                      {true, true, false, Label::Dynamic},
                                      {true, true, true, Label::Static}}};

TEST(DynamicMask, PaperRuleIsTable2ForEveryCombinationOfBoxes) {
  const auto add = [](DynamicMask& m, Detection d) { ASSERT_TRUE(m.boxes.items.try_push_back(d)); };
  const Box elsewhere{300, 300, 320, 320};
  for (const Row& row : kTable2) {
    // Also with boxes that do not count: of ignored classes around the point, of every kind elsewhere; each
    // kind once or twice; in either order.
    for (int variant = 0; variant < 16; ++variant) {
      DynamicMask mask;
      mask.rule = DynamicRule::Paper;
      std::array<std::pair<ClassKind, bool>, 3> kinds{{{ClassKind::Dynamic, row.in_dynamic},
                                                       {ClassKind::SemiStatic, row.in_semi_static},
                                                       {ClassKind::Static, row.in_static}}};
      if ((variant & 1) != 0) std::swap(kinds[0], kinds[2]);
      if ((variant & 2) != 0) add(mask, box(ClassKind::Ignored));
      for (const auto& [kind, inside] : kinds) {
        if (inside) add(mask, box(kind));
        if (inside && (variant & 4) != 0) add(mask, box(kind, {50, 50, 150, 150}));
        if ((variant & 8) != 0) add(mask, box(kind, elsewhere));
      }
      for (const double depth_m : {0.0, 2.5}) {
        EXPECT_EQ(label_at(mask, kX, kY, depth_m), row.label)
            << row.in_dynamic << row.in_semi_static << row.in_static << " variant " << variant;
      }
    }
  }
}

TEST(DynamicMask, BoxEdgesAreInclusiveLeftAndTopOnly) {
  DynamicMask mask;
  mask.rule = DynamicRule::Paper;
  ASSERT_TRUE(mask.boxes.items.try_push_back(box(ClassKind::Dynamic)));
  EXPECT_EQ(label_at(mask, 90, 90, 1), Label::Dynamic);
  EXPECT_EQ(label_at(mask, 89.99, 90, 1), Label::Static);
  EXPECT_EQ(label_at(mask, 109.99, 109.99, 1), Label::Dynamic);
  EXPECT_EQ(label_at(mask, 110, 100, 1), Label::Static);
  EXPECT_EQ(label_at(mask, 100, 110, 1), Label::Static);
}

TEST(DynamicMask, OffRejectsNothing) {
  DynamicMask mask;
  ASSERT_TRUE(mask.boxes.items.try_push_back(box(ClassKind::Dynamic)));
  EXPECT_EQ(label_at(mask, kX, kY, 1), Label::Static);
}

class Silhouette : public testing::Test {
 protected:
  Silhouette() {
    mask_.rule = DynamicRule::Silhouette;
    mask_.columns = 80;
    mask_.rows = 60;
    // The cell of (100, 100) is column 12, row 12 of 8 px cells.
    mask_.cells[12 * 80 + 12] = {1500, 2500, Label::Dynamic, 0};
    mask_.cells[59 * 80 + 79] = {1000, 2000, Label::SemiStatic, 1};
    // Only the cells speak: the box around the point is for those who made them.
    EXPECT_TRUE(mask_.boxes.items.try_push_back(box(ClassKind::Dynamic)));
  }
  DynamicMask mask_;
};

TEST_F(Silhouette, ACellIsSplitByDepth) {
  EXPECT_EQ(label_at(mask_, kX, kY, 1.499), Label::Static);
  EXPECT_EQ(label_at(mask_, kX, kY, 1.5), Label::Dynamic);
  EXPECT_EQ(label_at(mask_, kX, kY, 2.5), Label::Dynamic);
  EXPECT_EQ(label_at(mask_, kX, kY, 2.501), Label::Static);
  EXPECT_EQ(label_at(mask_, kX, kY, 0), Label::Unknown);
}

TEST_F(Silhouette, NeighbouringCellsAreTheirOwn) {
  EXPECT_EQ(label_at(mask_, 96, 96, 2), Label::Dynamic);
  EXPECT_EQ(label_at(mask_, 103.9, 103.9, 2), Label::Dynamic);
  EXPECT_EQ(label_at(mask_, 95.9, 100, 2), Label::Static);
  EXPECT_EQ(label_at(mask_, 104, 100, 2), Label::Static);
  EXPECT_EQ(label_at(mask_, 95.9, 100, 0), Label::Static) << "no object, so no depth is needed";
}

TEST_F(Silhouette, TheLastCellIsReachable) {
  EXPECT_EQ(label_at(mask_, 639, 479, 1.5), Label::SemiStatic);
}

}  // namespace
}  // namespace stillmap
