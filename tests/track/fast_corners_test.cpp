// SPDX-License-Identifier: Apache-2.0
#include "track/fast_corners.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <opencv2/features2d.hpp>

#include "scene.h"
#include "tests/support/shared_folder.h"

namespace stillmap {
namespace {

using test::Image;
using Corners = std::map<std::pair<int, int>, int>;  // (y, x) to score

/// Tiles the picture as far as the 19 px border allows. A seam is a tile's first or last row or column, where
/// suppression does not look across.
Corners ours(ImageView<const std::uint8_t> image, int threshold, int tile_px) {
  Corners all;
  for (int y0 = 19; y0 < image.height - 19; y0 += tile_px) {
    for (int x0 = 19; x0 < image.width - 19; x0 += tile_px) {
      CellCorners cell;
      fast_corners(image, x0, y0, std::min(x0 + tile_px, image.width - 19),
                   std::min(y0 + tile_px, image.height - 19), threshold, cell);
      EXPECT_LT(cell.size(), CellCorners::capacity());
      for (const Corner& c : cell)
        EXPECT_TRUE((all.insert({{c.y, c.x}, c.score}).second)) << "twice " << c.x << ", " << c.y;
    }
  }
  return all;
}

Corners theirs(ImageView<const std::uint8_t> image, int threshold, bool suppress) {
  const cv::Mat mat(image.height, image.width, CV_8U, const_cast<std::uint8_t*>(image.data),
                    static_cast<std::size_t>(image.stride));
  std::vector<cv::KeyPoint> points;
  cv::FAST(mat, points, threshold, suppress);
  Corners all;
  for (const cv::KeyPoint& p : points) {
    const int x = static_cast<int>(p.pt.x), y = static_cast<int>(p.pt.y);
    if (x < 19 || y < 19 || x >= image.width - 19 || y >= image.height - 19) continue;
    all[{y, x}] = static_cast<int>(p.response);
  }
  return all;
}

bool on_seam(std::pair<int, int> yx, int tile_px, ImageView<const std::uint8_t> image) {
  const auto at_edge = [&](int v, int size) {
    return (v - 19) % tile_px == 0 || (v - 19) % tile_px == tile_px - 1 || v == size - 20;
  };
  return at_edge(yx.first, image.height) || at_edge(yx.second, image.width);
}

bool neighbour_scores(const Corners& corners, std::pair<int, int> yx, int score) {
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      const auto near = corners.find({yx.first + dy, yx.second + dx});
      if ((dx != 0 || dy != 0) && near != corners.end() && near->second == score) return true;
    }
  }
  return false;
}

/// The same corners with the same scores, but for what is documented: of two equal neighbours OpenCV drops
/// both and we keep one; and at a tile's seam suppression sees one side only.
void expect_same(ImageView<const std::uint8_t> image, int threshold) {
  constexpr int kTile = 60;
  const Corners a = ours(image, threshold, kTile), b = theirs(image, threshold, true);
  ASSERT_GT(b.size(), 200u);
  for (const auto& [yx, score] : b) {
    const auto found = a.find(yx);
    ASSERT_TRUE(found != a.end()) << "missed " << yx.second << ", " << yx.first << " at threshold "
                                  << threshold;
    EXPECT_EQ(found->second, score) << yx.second << ", " << yx.first;
  }
  // Scores of all corners before suppression, to tell ties: FAST gives a response only with suppression, so
  // each extra corner is checked for an equal neighbour through our own detector on single pixels.
  const Corners unsuppressed = theirs(image, threshold, false);
  for (const auto& [yx, score] : a) {
    if (b.contains(yx)) continue;
    ASSERT_TRUE(unsuppressed.contains(yx)) << "no corner at all: " << yx.second << ", " << yx.first;
    Corners around;
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        CellCorners one;
        const int x = yx.second + dx, y = yx.first + dy;
        if (image.contains(x - 19, y - 19) && image.contains(x + 19, y + 19))
          fast_corners(image, x, y, x + 1, y + 1, threshold, one);
        if (!one.empty()) around[{y, x}] = one[0].score;
      }
    }
    EXPECT_TRUE(on_seam(yx, kTile, image) || neighbour_scores(around, yx, score))
        << "surplus " << yx.second << ", " << yx.first << " at threshold " << threshold;
  }
}

TEST(FastCorners, AgreesWithOpenCvOnARenderedPicture) {
  synthetic::SyntheticLog log({.seed = 3});
  const test::Scene scene(log, 0);
  for (const int threshold : {20, 7, 60}) expect_same(scene.grey.view(), threshold);
}

TEST(FastCorners, AgreesWithOpenCvOnARealPicture) {
  STILLMAP_NEEDS_SHARED();
  const auto files = test::list_rgbd(test::shared_folder() / "data/fr1_rpy");
  ASSERT_GT(files.size(), 90u);
  const Image<Bgr> colour = test::read_colour(files[90].colour);
  const Image<std::uint8_t> grey = test::grey_of(colour.pixels, colour.width, colour.height);
  for (const int threshold : {20, 7}) expect_same(grey.view(), threshold);
}

TEST(FastCorners, AgreesWithOpenCvOnNoise) {
  Image<std::uint8_t> noise(200, 150);
  Random random(4);
  for (std::uint8_t& p : noise.pixels) p = static_cast<std::uint8_t>(random.below(256));
  expect_same(noise.view(), 20);
}

/// A square's corner has score min(contrast) - 1: the largest threshold at which it is still one.
TEST(FastCorners, ScoreIsTheLargestThresholdThatKeepsTheCorner) {
  for (const int contrast : {9, 40, 200}) {
    Image<std::uint8_t> image(80, 80, 20);
    for (int y = 40; y < 80; ++y)
      std::fill_n(image.view().row(y) + 40, 40, static_cast<std::uint8_t>(20 + contrast));
    CellCorners corners;
    fast_corners(image.view(), 19, 19, 61, 61, 5, corners);
    ASSERT_FALSE(corners.empty());
    for (const Corner& c : corners) {
      EXPECT_EQ(c.score, contrast - 1);
      CellCorners again;
      fast_corners(image.view(), 19, 19, 61, 61, c.score, again);
      EXPECT_FALSE(again.empty());
      again.clear();
      fast_corners(image.view(), 19, 19, 61, 61, c.score + 1, again);
      EXPECT_TRUE(again.empty());
    }
  }
}

/// Nine of the circle's sixteen pixels make a corner, eight do not, wherever on the circle they begin.
TEST(FastCorners, NeedsNineInARow) {
  constexpr int kCircle[16][2] = {{0, -3}, {1, -3}, {2, -2}, {3, -1}, {3, 0},  {3, 1},   {2, 2},   {1, 3},
                                  {0, 3},  {-1, 3}, {-2, 2}, {-3, 1}, {-3, 0}, {-3, -1}, {-2, -2}, {-1, -3}};
  for (const int level : {30, 230}) {
    for (int start = 0; start < 16; ++start) {
      for (const int length : {8, 9, 16}) {
        Image<std::uint8_t> image(64, 64, 128);
        for (int i = 0; i < length; ++i) {
          const int* offset = kCircle[(start + i) % 16];
          image.view().at(32 + offset[0], 32 + offset[1]) = static_cast<std::uint8_t>(level);
        }
        CellCorners corners;
        fast_corners(image.view(), 32, 32, 33, 33, 20, corners);
        EXPECT_EQ(corners.size(), length >= 9 ? 1u : 0u) << "start " << start << ", length " << length;
      }
    }
  }
}

TEST(FastCorners, OfEqualNeighboursOneStays) {
  // Two columns of the same value: every inner row is like its neighbours.
  Image<std::uint8_t> image(80, 80, 0);
  image.view().at(40, 40) = image.view().at(41, 40) = 200;
  CellCorners corners;
  fast_corners(image.view(), 19, 19, 61, 61, 20, corners);
  int centre = 0;
  for (const Corner& c : corners) centre += c.y == 40 && (c.x == 40 || c.x == 41);
  EXPECT_EQ(centre, 1);
}

TEST(FastCorners, FlatAndExtremePicturesHaveNone) {
  for (const int value : {0, 128, 255}) {
    const Image<std::uint8_t> image(120, 120, static_cast<std::uint8_t>(value));
    CellCorners corners;
    fast_corners(image.view(), 19, 19, 101, 101, 1, corners);
    EXPECT_TRUE(corners.empty());
  }
}

/// Saturation: a bright centre near 255 and a dark one near 0 must not wrap around.
TEST(FastCorners, DoesNotWrapAroundAtTheEndsOfGrey) {
  for (const auto& [centre, ring] : {std::pair{250, 255}, {255, 250}, {5, 0}, {0, 5}}) {
    Image<std::uint8_t> image(64, 64, static_cast<std::uint8_t>(ring));
    image.view().at(32, 32) = static_cast<std::uint8_t>(centre);
    CellCorners corners;
    fast_corners(image.view(), 19, 19, 45, 45, 20, corners);
    EXPECT_TRUE(corners.empty()) << centre << " in " << ring;
  }
}

TEST(FastCorners, AFullListKeepsTheFirst) {
  Image<std::uint8_t> dots(166, 166, 0);
  for (int y = 0; y < 166; y += 4) {
    for (int x = 0; x < 166; x += 4) dots.view().at(x, y) = 250;
  }
  CellCorners corners;
  fast_corners(dots.view(), 19, 19, 147, 147, 20, corners);
  EXPECT_EQ(corners.size(), CellCorners::capacity());
  EXPECT_LT(corners[CellCorners::capacity() - 1].y, 147);
  EXPECT_TRUE(std::is_sorted(corners.begin(), corners.end(), [](const Corner& a, const Corner& b) {
    return std::pair(a.y, a.x) < std::pair(b.y, b.x);
  }));
}

TEST(FastCorners, AnEmptyRectangleHasNone) {
  Image<std::uint8_t> image(80, 80, 0);
  image.view().at(40, 40) = 200;
  CellCorners corners;
  fast_corners(image.view(), 40, 40, 40, 40, 20, corners);
  EXPECT_TRUE(corners.empty());
}

}  // namespace
}  // namespace stillmap
