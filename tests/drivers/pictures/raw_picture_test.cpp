// SPDX-License-Identifier: Apache-2.0
#include "drivers/pictures/raw_picture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "drivers/pictures/png.h"
#include "tests/drivers/pictures/picture_files.h"
#include "tests/support/heap_calls.h"

namespace stillmap {
namespace {

using Bytes = std::vector<std::byte>;

constexpr int kWidth = 6, kHeight = 4;

Bytes bytes(const std::vector<int>& values) {
  Bytes out;
  for (const int v : values) out.push_back(static_cast<std::byte>(v));
  return out;
}

/// BT.601 in studio range (ITU-R BT.601-7, section 2.5), in floating point.
Bgr reference(int y, int u, int v) {
  const double luma = 255.0 / 219 * (y - 16), cb = 255.0 / 224 * (u - 128), cr = 255.0 / 224 * (v - 128);
  const auto u8 = [](double x) { return static_cast<std::uint8_t>(std::clamp(std::lround(x), 0L, 255L)); };
  return {u8(luma + 1.772 * cb), u8(luma - 0.344136 * cb - 0.714136 * cr), u8(luma + 1.402 * cr)};
}

void expect_near(Bgr a, Bgr b, const char* what, int x, int y) {
  EXPECT_NEAR(a.b, b.b, 1) << what << " blue " << x << ", " << y;
  EXPECT_NEAR(a.g, b.g, 1) << what << " green " << x << ", " << y;
  EXPECT_NEAR(a.r, b.r, 1) << what << " red " << x << ", " << y;
}

struct Target {
  explicit Target(int width = kWidth, int height = kHeight)
      : pixels(static_cast<std::size_t>((width + 2) * height), Bgr{1, 2, 3}),
        view{pixels.data(), width, height, width + 2} {}
  /// Nothing beside the picture was written.
  bool margin_is_untouched() const {
    for (int y = 0; y < view.height; ++y) {
      for (int x = view.width; x < view.stride; ++x) {
        const Bgr p = view.row(y)[x];
        if (p.b != 1 || p.g != 2 || p.r != 3) return false;
      }
    }
    return true;
  }
  std::vector<Bgr> pixels;
  ImageView<Bgr> view;
};

DecodeStatus convert(const RawPicture& from, Target& into) {
  return ColourConverter(from.format, into.view.width, into.view.height).convert(from, into.view);
}

int luma(int x, int y) {
  return 16 + (37 * x + 53 * y) % 220;
}
int chroma_u(int x, int y) {
  return 16 + (91 * (x / 2) + 17 * y) % 225;
}
int chroma_v(int x, int y) {
  return 240 - (71 * (x / 2) + 29 * y) % 225;
}

TEST(RawPicture, YuyvIsBt601) {
  constexpr std::size_t kStride = 2 * kWidth + 3;
  Bytes data(kStride * kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      std::byte* at = data.data() + static_cast<std::size_t>(y) * kStride + 2 * x;
      at[0] = static_cast<std::byte>(luma(x, y));
      at[1] = static_cast<std::byte>(x % 2 == 0 ? chroma_u(x, y) : chroma_v(x, y));
    }
  }
  Target into;
  ASSERT_EQ(convert({PixelFormat::Yuyv, kWidth, kHeight, {{{data.data(), data.size(), kStride}}}}, into),
            DecodeStatus::Ok);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x)
      expect_near(into.view.at(x, y), reference(luma(x, y), chroma_u(x, y), chroma_v(x, y)), "YUYV", x, y);
  }
  EXPECT_TRUE(into.margin_is_untouched());
}

TEST(RawPicture, BlackWhiteAndThePrimariesAreExact) {
  // Y U V of the studio-range colours and what they stand for.
  const std::vector<std::pair<std::vector<int>, Bgr>> known{
      {{16, 128, 128}, {0, 0, 0}},  {{235, 128, 128}, {255, 255, 255}}, {{81, 90, 240}, {0, 0, 255}},
      {{145, 54, 34}, {1, 255, 0}}, {{41, 240, 110}, {255, 0, 0}},      {{126, 128, 128}, {128, 128, 128}}};
  for (const auto& [yuv, bgr] : known) {
    const Bytes data = bytes({yuv[0], yuv[1], yuv[0], yuv[2]});
    Target into(2, 1);
    ASSERT_EQ(convert({PixelFormat::Yuyv, 2, 1, {{{data.data(), 4, 4}}}}, into), DecodeStatus::Ok);
    for (int x = 0; x < 2; ++x) expect_near(into.view.at(x, 0), bgr, "known colour of Y", yuv[0], x);
  }
}

TEST(RawPicture, Nv12InOnePlaneAndInTwo) {
  constexpr std::size_t kStride = kWidth + 2;
  Bytes data(kStride * kHeight * 3 / 2);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x)
      data[static_cast<std::size_t>(y) * kStride + static_cast<std::size_t>(x)] =
          static_cast<std::byte>(luma(x, y));
  }
  std::byte* chroma = data.data() + kStride * kHeight;
  for (int y = 0; y < kHeight; y += 2) {
    for (int x = 0; x < kWidth; x += 2) {
      std::byte* at = chroma + static_cast<std::size_t>(y / 2) * kStride + x;
      at[0] = static_cast<std::byte>(chroma_u(x, y));
      at[1] = static_cast<std::byte>(chroma_v(x, y));
    }
  }
  constexpr std::size_t kOwnStride = kWidth + 6;
  Bytes apart(kOwnStride * kHeight / 2);
  for (std::size_t y = 0; y < kHeight / 2; ++y)
    std::copy_n(chroma + y * kStride, kWidth, apart.begin() + static_cast<std::ptrdiff_t>(y * kOwnStride));
  for (const bool two_planes : {false, true}) {
    RawPicture picture{PixelFormat::Nv12, kWidth, kHeight, {{{data.data(), data.size(), kStride}}}};
    if (two_planes) {
      std::fill(chroma, data.data() + data.size(), std::byte{0});
      picture.planes[0].bytes = kStride * kHeight;
      picture.planes[1] = {apart.data(), apart.size(), kOwnStride};
    }
    Target into;
    ASSERT_EQ(convert(picture, into), DecodeStatus::Ok);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const int block_y = y / 2 * 2;
        expect_near(into.view.at(x, y), reference(luma(x, y), chroma_u(x, block_y), chroma_v(x, block_y)),
                    "NV12", x, y);
      }
    }
  }
}

TEST(RawPicture, RgbBgrAndGreyAreExact) {
  const Bytes data = bytes({10, 20, 30, 40, 50, 60});
  for (const PixelFormat format : {PixelFormat::Rgb, PixelFormat::Bgr}) {
    Target into(2, 1);
    ASSERT_EQ(convert({format, 2, 1, {{{data.data(), 6, 6}}}}, into), DecodeStatus::Ok);
    const bool rgb = format == PixelFormat::Rgb;
    EXPECT_EQ(into.view.at(0, 0).b, rgb ? 30 : 10);
    EXPECT_EQ(into.view.at(0, 0).g, 20);
    EXPECT_EQ(into.view.at(0, 0).r, rgb ? 10 : 30);
    EXPECT_EQ(into.view.at(1, 0).b, rgb ? 60 : 40);
    EXPECT_TRUE(into.margin_is_untouched());
  }
  Target into(3, 2);
  ASSERT_EQ(convert({PixelFormat::Grey, 3, 2, {{{data.data(), 6, 3}}}}, into), DecodeStatus::Ok);
  const Bgr last = into.view.at(2, 1);
  EXPECT_EQ(last.b, 60);
  EXPECT_EQ(last.g, 60);
  EXPECT_EQ(last.r, 60);
}

TEST(RawPicture, MjpgIsDecodedAlsoWithPaddingAndWithoutHuffmanTables) {
  const std::vector<std::uint8_t> red(3 * kWidth * kHeight, 200);
  test::Bytes file = test::jpeg_file(test::JpegKind::Colour, kWidth, kHeight, red);
  const auto decode = [](const test::Bytes& data) {
    Target into;
    const DecodeStatus status =
        convert({PixelFormat::Mjpg, kWidth, kHeight, {{{data.data(), data.size(), 0}}}}, into);
    if (status == DecodeStatus::Ok) {
      EXPECT_NEAR(into.view.at(3, 2).r, 200, 2);
    }
    return status;
  };
  EXPECT_EQ(decode(file), DecodeStatus::Ok);
  test::Bytes padded = file;
  padded.insert(padded.end() - 2, 3, std::byte{0});  // before the end marker, as some webcams do
  EXPECT_EQ(decode(padded), DecodeStatus::Ok);
  // The tables of libjpeg's default are those that Motion JPEG leaves out.
  test::Bytes bare;
  for (std::size_t i = 0; i < file.size();) {
    if (file[i] == std::byte{0xff} && file[i + 1] == std::byte{0xc4}) {
      i += 2 + (std::to_integer<std::size_t>(file[i + 2]) << 8) + std::to_integer<std::size_t>(file[i + 3]);
      continue;
    }
    bare.push_back(file[i++]);
  }
  ASSERT_LT(bare.size(), file.size());
  EXPECT_EQ(decode(bare), DecodeStatus::Ok);
  EXPECT_EQ(decode(test::Bytes(file.begin(), file.begin() + 100)), DecodeStatus::Corrupt);
}

TEST(RawPicture, ShortBuffersOtherSizesAndOddOnesAreRefused) {
  Bytes data(3 * kWidth * kHeight);
  for (const PixelFormat format : {PixelFormat::Yuyv, PixelFormat::Nv12, PixelFormat::Rgb, PixelFormat::Bgr,
                                   PixelFormat::Grey, PixelFormat::Depth16}) {
    const std::size_t stride = row_bytes(format, kWidth), whole = picture_bytes(format, kHeight, stride);
    const RawPicture good{format, kWidth, kHeight, {{{data.data(), whole, stride}}}};
    RawPicture cut = good, narrow = good, empty = good;
    cut.planes[0].bytes = whole - 1;
    narrow.planes[0].stride_bytes = stride - 1;
    empty.planes[0].data = nullptr;
    for (const RawPicture& bad : {cut, narrow, empty}) {
      Target into;
      ImageView<const std::uint16_t> readings;
      EXPECT_EQ(format == PixelFormat::Depth16 ? depth_view(bad, readings) : convert(bad, into),
                DecodeStatus::Corrupt);
    }
    if (format == PixelFormat::Depth16) continue;
    Target other(kWidth - 2, kHeight);
    EXPECT_EQ(convert(good, other), DecodeStatus::WrongSize);
  }
  Target odd(5, 4);
  EXPECT_EQ(convert({PixelFormat::Yuyv, 5, 4, {{{data.data(), data.size(), 10}}}}, odd),
            DecodeStatus::Corrupt);
  Target into;
  EXPECT_EQ(
      convert({PixelFormat::Depth16, kWidth, kHeight, {{{data.data(), data.size(), 2 * kWidth}}}}, into),
      DecodeStatus::Corrupt);
}

TEST(RawPicture, DepthIsAViewIntoTheBuffer) {
  std::vector<std::uint16_t> readings{1, 2, 3, 9, 4, 5, 65535, 9};
  ImageView<const std::uint16_t> view;
  ASSERT_EQ(
      depth_view(
          {PixelFormat::Depth16, 3, 2, {{{reinterpret_cast<const std::byte*>(readings.data()), 14, 8}}}},
          view),
      DecodeStatus::Ok);
  EXPECT_EQ(view.data, readings.data());
  EXPECT_EQ(view.at(2, 0), 3);
  EXPECT_EQ(view.at(2, 1), 65535);
  EXPECT_EQ(
      depth_view(
          {PixelFormat::Depth16, 3, 2, {{{reinterpret_cast<const std::byte*>(readings.data()), 16, 7}}}},
          view),
      DecodeStatus::Corrupt)
      << "rows that begin in the middle of a reading";
}

TEST(PictureEncoders, PngIsExactAndJpegIsNear) {
  constexpr int kWide = 96, kHigh = 40, kStride = 100;
  std::vector<Bgr> colour(kStride * kHigh);
  std::vector<std::uint16_t> depth(kStride * kHigh);
  for (int y = 0; y < kHigh; ++y) {
    for (int x = 0; x < kStride; ++x) {
      const auto i = static_cast<std::size_t>(y * kStride + x);
      colour[i] = {static_cast<std::uint8_t>(2 * x), static_cast<std::uint8_t>(6 * y),
                   static_cast<std::uint8_t>(255 - x)};
      depth[i] = static_cast<std::uint16_t>(x * 7919 + y * 104729);
    }
  }
  const ImageView<const Bgr> colour_view{colour.data(), kWide, kHigh, kStride};
  const ImageView<const std::uint16_t> depth_view{depth.data(), kWide, kHigh, kStride};
  PngEncoder png(kWide, kHigh);
  JpegEncoder jpeg(Scratch(JpegEncoder::memory_bytes(kWide)), kWide, kHigh);
  std::vector<std::byte> jpeg_file(kWide * kHigh * 3);
  PngDecoder png_back;
  JpegDecoder jpeg_back(kWide, kHigh);
  std::vector<Bgr> colour_back(kWide * kHigh);
  std::vector<std::uint16_t> depth_back(kWide * kHigh);
  const ImageView<Bgr> colour_into{colour_back.data(), kWide, kHigh, kWide};
  // On ARM a thread's first JPEG reads from the system what the processor can do.
  ASSERT_GT(jpeg.encode(colour_view, 95, jpeg_file), 0u);
  for (int round = 0; round < 3; ++round) {
    const long before = test::heap_calls();
    const auto depth_file = png.encode_depth(depth_view);
    ASSERT_EQ(png_back.decode_depth(depth_file, {depth_back.data(), kWide, kHigh, kWide}), DecodeStatus::Ok);
    const auto colour_file = png.encode_colour(colour_view);
    ASSERT_EQ(png_back.decode_colour(colour_file, colour_into), DecodeStatus::Ok);
    for (int y = 0; y < kHigh; ++y) {
      for (int x = 0; x < kWide; ++x) {
        const auto i = static_cast<std::size_t>(y * kWide + x);
        ASSERT_EQ(depth_back[i], depth_view.at(x, y));
        ASSERT_EQ(colour_back[i].b, colour_view.at(x, y).b);
        ASSERT_EQ(colour_back[i].g, colour_view.at(x, y).g);
        ASSERT_EQ(colour_back[i].r, colour_view.at(x, y).r);
      }
    }
    const std::size_t bytes = jpeg.encode(colour_view, 95, jpeg_file);
    ASSERT_EQ(jpeg_back.decode_colour(std::span(jpeg_file).first(bytes), colour_into), DecodeStatus::Ok);
    EXPECT_EQ(test::heap_calls(), before) << "round " << round;
    for (int y = 0; y < kHigh; ++y) {
      for (int x = 0; x < kWide; ++x) {
        const auto i = static_cast<std::size_t>(y * kWide + x);
        ASSERT_NEAR(colour_back[i].g, colour_view.at(x, y).g, 12);
      }
    }
  }
  EXPECT_TRUE(PngEncoder(8, 8).encode_depth(depth_view).empty());
  EXPECT_EQ(jpeg.encode(colour_view, 95, std::span(jpeg_file).first(500)), 0u) << "it does not fit";
  EXPECT_GT(jpeg.encode(colour_view, 95, jpeg_file), 500u) << "and the next one is made all the same";
  EXPECT_EQ(JpegEncoder(Scratch(JpegEncoder::memory_bytes(8)), 8, 8).encode(colour_view, 95, jpeg_file), 0u);
}

TEST(PictureEncoders, NoiseFitsToo) {
  constexpr int kWide = 128, kHigh = 64;
  std::vector<Bgr> colour(kWide * kHigh);
  std::uint32_t state = 1;
  const auto noise = [&] { return static_cast<std::uint8_t>((state = state * 1664525 + 1013904223) >> 24); };
  for (Bgr& p : colour) p = {noise(), noise(), noise()};
  const ImageView<const Bgr> view{colour.data(), kWide, kHigh, kWide};
  EXPECT_FALSE(PngEncoder(kWide, kHigh).encode_colour(view).empty());
  std::vector<std::byte> jpeg_file(kWide * kHigh * 3 + (1 << 16));
  JpegEncoder jpeg(Scratch(JpegEncoder::memory_bytes(kWide)), kWide, kHigh);
  EXPECT_GT(jpeg.encode(view, 100, jpeg_file), 0u);
}

}  // namespace
}  // namespace stillmap
