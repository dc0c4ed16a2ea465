// SPDX-License-Identifier: Apache-2.0
#include "map/lens.h"

#include <gtest/gtest.h>

#include "map_scene.h"

namespace stillmap {
namespace {

using test::small_camera;

struct LensUnderTest {
  CameraModel camera;
  Arena arena{1 << 20};
  RayTable rays{arena, camera};
  Lens lens{camera, rays, false};
};

TEST(Lens, agrees_with_the_camera_model_over_the_whole_picture) {
  LensUnderTest t{small_camera(true)};
  for (int y = 0; y < t.camera.height; ++y) {
    for (int x = 0; x < t.camera.width; ++x) {
      for (const double z : {0.35, 2.0, 7.0}) {
        // A third of a pixel off the centre, so that rounding has a right answer.
        const Vec2 ray = t.camera.undistort({x + 0.3, y - 0.3});
        const Lens::Pixel p = t.lens.pixel_of(static_cast<float>(ray.x * z), static_cast<float>(ray.y * z),
                                              static_cast<float>(z));
        if (x == 0 || y == 0 || x == t.camera.width - 1 || y == t.camera.height - 1)
          continue;  // may be outside
        ASSERT_EQ(p.u, x) << y;
        ASSERT_EQ(p.v, y) << x;
      }
    }
  }
}

TEST(Lens, a_row_is_its_points) {
  LensUnderTest t{small_camera(true)};
  const std::array<float, 3> begin{-0.3f, 0.2f, 1.0f}, step{0.07f, -0.03f, 0.11f};
  const Lens::PixelRow row = t.lens.pixels_of(begin, step);
  for (std::size_t i = 0; i < Lens::kRow; ++i) {
    const float s = static_cast<float>(i);
    const Lens::Pixel p =
        t.lens.pixel_of(begin[0] + s * step[0], begin[1] + s * step[1], begin[2] + s * step[2]);
    EXPECT_EQ(row.u[i], p.u);
    if (p.u >= 0) {
      EXPECT_EQ(row.v[i], p.v);
    }
  }
}

TEST(Lens, points_outside_have_no_pixel) {
  LensUnderTest t{small_camera(true)};
  for (const std::array<float, 3>& p : std::initializer_list<std::array<float, 3>>{{0, 0, -1},
                                                                                   {0, 0, 0},
                                                                                   {0, 0, 0.01f},
                                                                                   {3, 0, 1},
                                                                                   {-3, 0, 1},
                                                                                   {0, 3, 1},
                                                                                   {0, -3, 1},
                                                                                   {1e30f, 1e30f, 1},
                                                                                   {1e9f, 0, 1e-9f}}) {
    EXPECT_EQ(t.lens.pixel_of(p[0], p[1], p[2]).u, -1) << p[0] << " " << p[1] << " " << p[2];
  }
}

TEST(Lens, a_polynomial_that_folds_back_shows_nothing_twice) {
  CameraModel folding = small_camera();
  folding.k1 = -0.15;  // x (1 - 0.15 x^2) comes back to 0 at x = 2.6
  LensUnderTest t{folding};
  EXPECT_GE(folding.project({2.5, 0, 1}).x, 0)
      << "the polynomial itself does not fold, the test means nothing";
  EXPECT_LT(folding.project({2.5, 0, 1}).x, folding.width);
  EXPECT_EQ(t.lens.pixel_of(2.5f, 0, 1).u, -1);
}

TEST(Lens, may_see_never_denies_what_has_a_pixel) {
  LensUnderTest t{small_camera(true)};
  int seen = 0, maybe = 0;
  for (float x = -4; x <= 4; x += 0.13f) {
    for (float y = -4; y <= 4; y += 0.13f) {
      for (float z = -1; z <= 4; z += 0.21f) {
        const bool has_pixel = t.lens.pixel_of(x, y, z).u >= 0;
        seen += has_pixel;
        maybe += t.lens.may_see(x, y, z, 0.2f);
        if (has_pixel) {
          ASSERT_TRUE(t.lens.may_see(x, y, z, 0)) << x << " " << y << " " << z;
        }
        if (t.lens.pixel_of(x + 0.1f, y, z + 0.1f).u >= 0) {
          ASSERT_TRUE(t.lens.may_see(x, y, z, 0.2f));
        }
      }
    }
  }
  EXPECT_GT(seen, 1000);
  EXPECT_LT(maybe, 3 * seen) << "hardly anything is culled";
}

}  // namespace
}  // namespace stillmap
