// SPDX-License-Identifier: Apache-2.0
#include "tests/support/read_image.h"

#include <jpeglib.h>
#include <spng.h>

#include <csetjmp>
#include <cstdio>  // jpeglib.h wants FILE declared before it
#include <fstream>
#include <iterator>
#include <memory>
#include <sstream>
#include <utility>

namespace stillmap::test {

namespace {

std::vector<unsigned char> read_bytes(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

/// Decodes into `T` pixels of `format`; only a file with `bit_depth` bits a channel is taken.
template <class T>
Image<T> read_png(const std::filesystem::path& file, int format, int bit_depth) {
  const std::vector<unsigned char> bytes = read_bytes(file);
  const std::unique_ptr<spng_ctx, void (*)(spng_ctx*)> context(spng_ctx_new(0), spng_ctx_free);
  spng_ihdr header{};
  std::size_t size = 0;
  if (spng_set_png_buffer(context.get(), bytes.data(), bytes.size()) != 0 ||
      spng_get_ihdr(context.get(), &header) != 0 || header.bit_depth != bit_depth ||
      spng_decoded_image_size(context.get(), format, &size) != 0) {
    return {};
  }
  Image<T> image(static_cast<int>(header.width), static_cast<int>(header.height));
  if (size != image.pixels.size() * sizeof(T)) return {};
  if (spng_decode_image(context.get(), image.pixels.data(), size, format, 0) != 0) return {};
  return image;
}

/// libjpeg's way out of an error is a jump.
struct JpegErrors {
  jpeg_error_mgr base{};
  std::jmp_buf escape{};
};
[[noreturn]] void escape_from_jpeg(j_common_ptr jpeg) {
  std::longjmp(reinterpret_cast<JpegErrors*>(jpeg->err)->escape, 1);
}

Image<Bgr> read_jpeg(const std::filesystem::path& file) {
  const std::vector<unsigned char> bytes = read_bytes(file);
  Image<Bgr> image;
  JpegErrors errors;
  jpeg_decompress_struct jpeg{};
  jpeg.err = jpeg_std_error(&errors.base);
  errors.base.error_exit = escape_from_jpeg;
  jpeg_create_decompress(&jpeg);
  if (setjmp(errors.escape) != 0) {
    jpeg_destroy_decompress(&jpeg);
    return {};
  }
  jpeg_mem_src(&jpeg, bytes.data(), bytes.size());
  jpeg_read_header(&jpeg, TRUE);
  jpeg.out_color_space = JCS_EXT_BGR;
  jpeg_start_decompress(&jpeg);
  image = Image<Bgr>(static_cast<int>(jpeg.output_width), static_cast<int>(jpeg.output_height));
  while (jpeg.output_scanline < jpeg.output_height) {
    JSAMPROW row = reinterpret_cast<JSAMPROW>(image.view().row(static_cast<int>(jpeg.output_scanline)));
    jpeg_read_scanlines(&jpeg, &row, 1);
  }
  jpeg_destroy_decompress(&jpeg);
  return image;
}

}  // namespace

Image<Bgr> read_colour(const std::filesystem::path& file) {
  if (file.extension() == ".jpg") return read_jpeg(file);
  Image<Bgr> image = read_png<Bgr>(file, SPNG_FMT_RGB8, 8);
  for (Bgr& pixel : image.pixels) std::swap(pixel.b, pixel.r);
  return image;
}

Image<std::uint16_t> read_depth(const std::filesystem::path& file) {
  return read_png<std::uint16_t>(file, SPNG_FMT_PNG, 16);
}

Image<std::uint8_t> read_grey(const std::filesystem::path& file) {
  return read_png<std::uint8_t>(file, SPNG_FMT_PNG, 8);
}

std::vector<RgbdFiles> list_rgbd(const std::filesystem::path& folder) {
  std::ifstream in(folder / "associations.txt");
  std::vector<RgbdFiles> files;
  std::string line, colour_stamp, colour, depth_stamp, depth;
  while (std::getline(in, line)) {
    std::istringstream words(line);
    if (line.empty() || line[0] == '#') continue;
    if (words >> colour_stamp >> colour >> depth_stamp >> depth)
      files.push_back({folder / colour, folder / depth});
  }
  return files;
}

}  // namespace stillmap::test
