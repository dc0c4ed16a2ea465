// SPDX-License-Identifier: Apache-2.0
#include "drivers/pictures/png.h"

#include <gtest/gtest.h>

#include "tests/drivers/pictures/picture_files.h"

namespace stillmap {
namespace {

using test::Bytes;
using test::PngKind;

constexpr int kWidth = 37, kHeight = 21, kStride = 40;
constexpr Bgr kUntouched{1, 2, 3};

/// A picture inside a wider memory, to see that nothing is written beside it.
template <class T>
struct Canvas {
  explicit Canvas(T fill) : memory(static_cast<std::size_t>(kStride * kHeight), fill) {}
  ImageView<T> view() { return {memory.data(), kWidth, kHeight, kStride}; }
  std::vector<T> memory;
};

bool operator_equal(Bgr a, Bgr b) {
  return a.b == b.b && a.g == b.g && a.r == b.r;
}

int red(int x, int y) {
  return (7 * x + 3 * y) % 256;
}
int green(int x, int y) {
  return (255 - 5 * x + y + 256) % 256;
}
int blue(int x, int y) {
  return (x * y) % 256;
}

std::vector<std::uint16_t> samples_of(PngKind kind) {
  std::vector<std::uint16_t> samples;
  const auto add = [&](int v) { samples.push_back(static_cast<std::uint16_t>(v)); };
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      add(kind == PngKind::Grey16 ? 1000 * y + 257 * x + 3 : red(x, y));
      if (kind != PngKind::Rgb8 && kind != PngKind::Rgba8) continue;
      add(green(x, y));
      add(blue(x, y));
      if (kind == PngKind::Rgba8) add(x % 2 == 0 ? 0 : 255);
    }
  }
  return samples;
}

Bytes png(PngKind kind, test::PngOptions options = {}) {
  return test::png_file(kind, kWidth, kHeight, samples_of(kind), options);
}

Bgr expected(PngKind kind, int x, int y) {
  const auto u8 = [](int v) { return static_cast<std::uint8_t>(v); };
  const int r = red(x, y);
  if (kind == PngKind::Grey8) return {u8(r), u8(r), u8(r)};
  if (kind == PngKind::Palette8) return {7, u8(255 - r), u8(r)};
  return {u8(blue(x, y)), u8(green(x, y)), u8(r)};
}

class PngColour : public testing::TestWithParam<std::tuple<PngKind, bool>> {};

TEST_P(PngColour, EveryKindComesAsBgrInPlace) {
  const auto [kind, interlaced] = GetParam();
  PngDecoder decoder;
  Canvas<Bgr> canvas(kUntouched);
  ASSERT_EQ(decoder.decode_colour(png(kind, {interlaced, {}}), canvas.view()), DecodeStatus::Ok);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      ASSERT_TRUE(operator_equal(canvas.view().at(x, y), expected(kind, x, y))) << x << ", " << y;
    }
    for (int x = kWidth; x < kStride; ++x) {
      ASSERT_TRUE(operator_equal(canvas.memory[static_cast<std::size_t>(y * kStride + x)], kUntouched));
    }
  }
}
std::string name_of(const testing::TestParamInfo<PngColour::ParamType>& info) {
  const auto [kind, interlaced] = info.param;
  const char* text = kind == PngKind::Grey8   ? "Grey"
                     : kind == PngKind::Rgb8  ? "Rgb"
                     : kind == PngKind::Rgba8 ? "Rgba"
                                              : "Palette";
  return std::string(text) + (interlaced ? "Interlaced" : "");
}
INSTANTIATE_TEST_SUITE_P(Kinds, PngColour,
                         testing::Combine(testing::Values(PngKind::Grey8, PngKind::Rgb8, PngKind::Rgba8,
                                                          PngKind::Palette8),
                                          testing::Bool()),
                         name_of);

TEST(PngDecoder, DepthKeepsEveryReadingInHostOrder) {
  PngDecoder decoder;
  for (const bool interlaced : {false, true}) {
    Canvas<std::uint16_t> canvas(9);
    ASSERT_EQ(decoder.decode_depth(png(PngKind::Grey16, {interlaced, {}}), canvas.view()), DecodeStatus::Ok);
    const std::vector<std::uint16_t> wanted = samples_of(PngKind::Grey16);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        ASSERT_EQ(canvas.view().at(x, y), wanted[static_cast<std::size_t>(y * kWidth + x)]);
      }
      ASSERT_EQ(canvas.view().row(y)[kWidth], 9);
    }
  }
}

TEST(PngDecoder, ForeignKindsAreCorrupt) {
  PngDecoder decoder;
  Canvas<Bgr> colour(kUntouched);
  Canvas<std::uint16_t> depth(9);
  EXPECT_EQ(decoder.decode_colour(png(PngKind::Grey16), colour.view()), DecodeStatus::Corrupt)
      << "depth as colour";
  EXPECT_EQ(decoder.decode_depth(png(PngKind::Grey8), depth.view()), DecodeStatus::Corrupt) << "8-bit depth";
  EXPECT_EQ(decoder.decode_depth(png(PngKind::Rgb8), depth.view()), DecodeStatus::Corrupt)
      << "colour as depth";
  EXPECT_EQ(decoder.decode_depth({}, depth.view()), DecodeStatus::Corrupt) << "empty";
}

TEST(PngDecoder, AnotherSizeLeavesTheViewUntouched) {
  PngDecoder decoder;
  Canvas<std::uint16_t> canvas(9);
  ImageView<std::uint16_t> view = canvas.view();
  --view.width;
  EXPECT_EQ(decoder.decode_depth(png(PngKind::Grey16), view), DecodeStatus::WrongSize);
  EXPECT_EQ(canvas.memory, std::vector<std::uint16_t>(canvas.memory.size(), 9));
}

TEST(PngDecoder, TextBesidesThePixelsIsRead) {
  PngDecoder decoder;
  Canvas<std::uint16_t> canvas(9);
  const Bytes file = png(PngKind::Grey16, {false, std::string(100'000, 'x')});
  EXPECT_EQ(decoder.decode_depth(file, canvas.view()), DecodeStatus::Ok);
  const Bytes bomb = png(PngKind::Grey16, {false, std::string(100'000'000, 'x')});
  EXPECT_NE(decoder.decode_depth(bomb, canvas.view()), DecodeStatus::WrongSize)
      << "must not take unbounded memory";
  EXPECT_EQ(decoder.decode_depth(file, canvas.view()), DecodeStatus::Ok) << "and works on after it";
}

TEST(PngDecoder, EveryCutAndEveryFlippedByteIsSeen) {
  PngDecoder decoder;
  Canvas<std::uint16_t> canvas(9);
  const Bytes file = png(PngKind::Grey16);
  const std::size_t last = file.size() - 4;  // behind it, the empty end mark's checksum guards nothing
  for (std::size_t size = 0; size < last; ++size) {
    ASSERT_NE(decoder.decode_depth(std::span(file).first(size), canvas.view()), DecodeStatus::Ok)
        << "cut at " << size;
  }
  for (std::size_t i = 0; i < last; ++i) {
    Bytes damaged = file;
    damaged[i] ^= std::byte{0x10};
    ASSERT_NE(decoder.decode_depth(damaged, canvas.view()), DecodeStatus::Ok) << "flipped at " << i;
  }
  EXPECT_EQ(decoder.decode_depth(file, canvas.view()), DecodeStatus::Ok) << "and a good file is still good";
}

}  // namespace
}  // namespace stillmap
