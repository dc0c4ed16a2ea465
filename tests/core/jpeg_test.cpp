// SPDX-License-Identifier: Apache-2.0
#include "core/jpeg.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/drivers/pictures/picture_files.h"

namespace stillmap {
namespace {

using test::Bytes;
using test::JpegKind;

constexpr int kWidth = 37, kHeight = 21, kStride = 40;
constexpr Bgr kUntouched{1, 2, 3};

bool is_untouched(Bgr p) {
  return p.b == kUntouched.b && p.g == kUntouched.g && p.r == kUntouched.r;
}

/// A picture inside a wider memory, to see that nothing is written beside it.
struct Canvas {
  std::vector<Bgr> memory = std::vector<Bgr>(kStride * kHeight, kUntouched);
  ImageView<Bgr> view() { return {memory.data(), kWidth, kHeight, kStride}; }
};

/// Smooth, so that JPEG's loss stays small.
std::vector<std::uint8_t> smooth(int channels) {
  std::vector<std::uint8_t> samples;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      samples.push_back(static_cast<std::uint8_t>(200 - x));
      if (channels == 1) continue;
      samples.push_back(static_cast<std::uint8_t>(40 + 2 * y));
      samples.push_back(static_cast<std::uint8_t>(90 + x - y));
    }
  }
  return samples;
}

Bytes jpeg(JpegKind kind) {
  return test::jpeg_file(kind, kWidth, kHeight, smooth(kind == JpegKind::Grey ? 1 : 3));
}

TEST(JpegDecoder, EveryKindComesAsBgrInPlace) {
  JpegDecoder decoder(kWidth, kHeight);
  for (const JpegKind kind :
       {JpegKind::Colour, JpegKind::Grey, JpegKind::ProgressiveColour, JpegKind::Colour}) {
    Canvas canvas;
    ASSERT_EQ(decoder.decode_colour(jpeg(kind), canvas.view()), DecodeStatus::Ok);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const Bgr p = canvas.view().at(x, y);
        ASSERT_NEAR(p.r, 200 - x, 4);
        ASSERT_NEAR(p.g, kind == JpegKind::Grey ? 200 - x : 40 + 2 * y, 4);
        ASSERT_NEAR(p.b, kind == JpegKind::Grey ? 200 - x : 90 + x - y, 4);
      }
      ASSERT_TRUE(is_untouched(canvas.view().row(y)[kWidth]));
    }
  }
}

TEST(JpegDecoder, AnotherSizeLeavesTheViewUntouched) {
  JpegDecoder decoder(kWidth, kHeight);
  Canvas canvas;
  ImageView<Bgr> view = canvas.view();
  --view.height;
  EXPECT_EQ(decoder.decode_colour(jpeg(JpegKind::Colour), view), DecodeStatus::WrongSize);
  for (const Bgr& p : canvas.memory) ASSERT_TRUE(is_untouched(p));
  EXPECT_EQ(decoder.decode_colour(jpeg(JpegKind::Colour), canvas.view()), DecodeStatus::Ok);
}

TEST(JpegDecoder, EveryCutIsSeenAndNoFlipEndsTheProcess) {
  JpegDecoder decoder(kWidth, kHeight);
  Canvas canvas;
  for (const JpegKind kind : {JpegKind::Colour, JpegKind::ProgressiveColour}) {
    const Bytes file = jpeg(kind);
    for (std::size_t size = 0; size + 2 < file.size(); ++size) {  // the last two bytes are the end mark
      ASSERT_NE(decoder.decode_colour(std::span(file).first(size), canvas.view()), DecodeStatus::Ok) << size;
    }
    for (std::size_t i = 0; i < file.size(); ++i) {
      for (const int flip : {0x01, 0x80, 0xff}) {
        Bytes damaged = file;
        damaged[i] ^= static_cast<std::byte>(flip);
        decoder.decode_colour(damaged, canvas.view());
      }
    }
    EXPECT_EQ(decoder.decode_colour(file, canvas.view()), DecodeStatus::Ok)
        << "and a good file is still good";
  }
}

}  // namespace
}  // namespace stillmap
