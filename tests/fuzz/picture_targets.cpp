// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cstring>
#include <vector>

#include "drivers/pictures/png.h"
#include "drivers/pictures/raw_picture.h"
#include "tests/fuzz/targets.h"

namespace stillmap::fuzz {

namespace {

constexpr int kWidth = 16, kHeight = 12;  // of the seeds; other sizes are refused

/// A picture between two rows that nobody may touch.
template <class Pixel>
class Canvas {
 public:
  Canvas() : pixels_(kWidth * (kHeight + 2), kUntouched) {}
  ~Canvas() {
    for (int x = 0; x < kWidth; ++x)
      require(same(pixels_[static_cast<std::size_t>(x)]) &&
              same(pixels_[pixels_.size() - 1 - static_cast<std::size_t>(x)]));
  }
  Canvas(const Canvas&) = delete;
  Canvas& operator=(const Canvas&) = delete;
  ImageView<Pixel> view() { return {pixels_.data() + kWidth, kWidth, kHeight, kWidth}; }

 private:
  static constexpr Pixel kUntouched{};
  static bool same(const Pixel& p) { return std::memcmp(&p, &kUntouched, sizeof(Pixel)) == 0; }
  std::vector<Pixel> pixels_;
};

std::span<const std::byte> file_of(Bytes bytes) {
  return std::as_bytes(bytes);
}

}  // namespace

void decode_png(Bytes bytes) {
  static PngDecoder decoder;
  Canvas<Bgr> colour;
  Canvas<std::uint16_t> depth;
  static_cast<void>(PngDecoder::is_png(file_of(bytes)));
  static_cast<void>(decoder.decode_colour(file_of(bytes), colour.view()));
  static_cast<void>(decoder.decode_depth(file_of(bytes), depth.view()));
}

void decode_jpeg(Bytes bytes) {
  static JpegDecoder from_file(kWidth, kHeight), from_camera(kWidth, kHeight, JpegDecoder::Source::Camera);
  for (JpegDecoder* decoder : {&from_file, &from_camera}) {
    Canvas<Bgr> colour;
    static_cast<void>(decoder->decode_colour(file_of(bytes), colour.view()));
  }
}

void convert_camera_picture(Bytes bytes) {
  constexpr std::size_t kHead = 8;
  if (bytes.size() < kHead) return;
  // A buffer of the driver's own size, so that reading beyond it shows.
  const std::vector<std::uint8_t> buffer(bytes.begin() + kHead, bytes.end());
  const auto data = file_of(buffer);
  RawPicture picture;
  picture.format = static_cast<PixelFormat>(bytes[0] % 7);
  picture.width = bytes[1] % 4 == 0 ? bytes[2] : kWidth;
  picture.height = bytes[1] % 8 == 0 ? bytes[3] : kHeight;
  const std::size_t second = std::min<std::size_t>(bytes[6] * 4u, data.size());
  picture.planes[0] = {data.data(), data.size(), bytes[4] + 256u * (bytes[1] / 128u)};
  if (bytes[1] & 64u) {
    picture.planes[0].bytes = second;
    picture.planes[1] = {data.data() + second, data.size() - second, bytes[5]};
  }
  static ColourConverter plain(PixelFormat::Bgr, kWidth, kHeight), jpeg(PixelFormat::Mjpg, kWidth, kHeight);
  Canvas<Bgr> colour;
  static_cast<void>((picture.format == PixelFormat::Mjpg ? jpeg : plain).convert(picture, colour.view()));
  ImageView<const std::uint16_t> depth{};
  if (depth_view(picture, depth) != DecodeStatus::Ok) return;
  std::uint32_t sum = 0;
  for (int y = 0; y < depth.height; ++y) {
    for (int x = 0; x < depth.width; ++x) sum += depth.at(x, y);
  }
  require(sum <= 65535u * 256 * 256);
}

}  // namespace stillmap::fuzz
