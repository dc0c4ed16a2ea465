// SPDX-License-Identifier: Apache-2.0
#include "detect/letterbox.h"

#include <gtest/gtest.h>

namespace stillmap {
namespace {

TEST(Letterbox, CentresAWidePicture) {
  const Letterbox l(640, 480, 320, 256);
  EXPECT_EQ(l.width, 320);
  EXPECT_EQ(l.height, 240);
  EXPECT_EQ(l.x0, 0);
  EXPECT_EQ(l.y0, 8);
  EXPECT_DOUBLE_EQ(l.scale, 0.5);
}

TEST(Letterbox, CentresATallPicture) {
  const Letterbox l(360, 540, 320, 256);
  EXPECT_EQ(l.height, 256);
  EXPECT_EQ(l.width, 171);
  EXPECT_EQ(l.x0, 74);
  EXPECT_EQ(l.y0, 0);
}

TEST(Letterbox, BoxesComeBack) {
  for (const auto& [w, h] :
       {std::pair(640, 480), std::pair(540, 360), std::pair(360, 540), std::pair(1280, 960)}) {
    const Letterbox l(w, h, 320, 256);
    const Box picture{12.5f, 30, static_cast<float>(w) - 40, static_cast<float>(h) - 7};
    const auto into = [&](float v, int offset) { return static_cast<float>(v * l.scale + offset); };
    const Box back = l.to_picture(
        {into(picture.x0, l.x0), into(picture.y0, l.y0), into(picture.x1, l.x0), into(picture.y1, l.y0)});
    EXPECT_NEAR(back.x0, picture.x0, 1e-3);
    EXPECT_NEAR(back.y0, picture.y0, 1e-3);
    EXPECT_NEAR(back.x1, picture.x1, 1e-3);
    EXPECT_NEAR(back.y1, picture.y1, 1e-3);
  }
}

TEST(Letterbox, ClipsToThePicture) {
  const Box b = Letterbox(640, 480, 320, 256).to_picture({-50, -50, 400, 400});
  EXPECT_EQ(b.x0, 0);
  EXPECT_EQ(b.y0, 0);
  EXPECT_EQ(b.x1, 640);
  EXPECT_EQ(b.y1, 480);
}

}  // namespace
}  // namespace stillmap
