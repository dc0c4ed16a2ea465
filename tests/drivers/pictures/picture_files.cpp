// SPDX-License-Identifier: Apache-2.0
#include "tests/drivers/pictures/picture_files.h"

#include <spng.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>

// jpeglib.h uses names of stdio.h without including it.
// clang-format off
#include <jpeglib.h>
// clang-format on

namespace stillmap::test {

namespace {

struct Format {
  std::uint8_t colour_type, bits;
  int channels;
};
Format format_of(PngKind kind) {
  switch (kind) {
    case PngKind::Grey8:
      return {SPNG_COLOR_TYPE_GRAYSCALE, 8, 1};
    case PngKind::Grey16:
      return {SPNG_COLOR_TYPE_GRAYSCALE, 16, 1};
    case PngKind::Rgb8:
      return {SPNG_COLOR_TYPE_TRUECOLOR, 8, 3};
    case PngKind::Rgba8:
      return {SPNG_COLOR_TYPE_TRUECOLOR_ALPHA, 8, 4};
    case PngKind::Palette8:
      return {SPNG_COLOR_TYPE_INDEXED, 8, 1};
  }
  std::abort();
}

void expect_ok(int error) {
  if (error != 0) throw std::runtime_error(spng_strerror(error));
}

}  // namespace

Bytes png_file(PngKind kind, int width, int height, std::span<const std::uint16_t> samples,
               PngOptions options) {
  const Format format = format_of(kind);
  spng_ctx* context = spng_ctx_new(SPNG_CTX_ENCODER);
  expect_ok(spng_set_option(context, SPNG_ENCODE_TO_BUFFER, 1));
  spng_ihdr header{static_cast<std::uint32_t>(width),
                   static_cast<std::uint32_t>(height),
                   format.bits,
                   format.colour_type,
                   0,
                   0,
                   static_cast<std::uint8_t>(options.interlaced ? 1 : 0)};
  expect_ok(spng_set_ihdr(context, &header));
  spng_plte palette{};
  if (kind == PngKind::Palette8) {
    palette.n_entries = 256;
    for (unsigned i = 0; i < 256; ++i) {
      palette.entries[i] = {static_cast<std::uint8_t>(i), static_cast<std::uint8_t>(255 - i), 7, 255};
    }
    expect_ok(spng_set_plte(context, &palette));
  }
  spng_text text{};
  if (!options.text.empty()) {
    text.keyword[0] = 'k';
    text.type = SPNG_ZTXT;
    text.text = options.text.data();
    text.length = options.text.size();
    expect_ok(spng_set_text(context, &text, 1));
  }
  Bytes pixels;
  for (const std::uint16_t sample : samples) {
    pixels.push_back(static_cast<std::byte>(sample & 255));
    if (format.bits == 16) pixels.push_back(static_cast<std::byte>(sample >> 8));
  }
  expect_ok(spng_encode_image(context, pixels.data(), pixels.size(), SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE));
  std::size_t size = 0;
  int error = 0;
  void* file = spng_get_png_buffer(context, &size, &error);
  expect_ok(error);
  Bytes bytes(static_cast<std::byte*>(file), static_cast<std::byte*>(file) + size);
  std::free(file);
  spng_ctx_free(context);
  return bytes;
}

Bytes jpeg_file(JpegKind kind, int width, int height, std::span<const std::uint8_t> samples) {
  jpeg_compress_struct info{};
  jpeg_error_mgr error{};
  info.err = jpeg_std_error(&error);
  jpeg_create_compress(&info);
  unsigned char* file = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&info, &file, &size);
  info.image_width = static_cast<JDIMENSION>(width);
  info.image_height = static_cast<JDIMENSION>(height);
  info.input_components = kind == JpegKind::Grey ? 1 : 3;
  info.in_color_space = kind == JpegKind::Grey ? JCS_GRAYSCALE : JCS_RGB;
  jpeg_set_defaults(&info);
  jpeg_set_quality(&info, 100, TRUE);
  info.comp_info[0].h_samp_factor = info.comp_info[0].v_samp_factor = 1;
  if (kind == JpegKind::ProgressiveColour) jpeg_simple_progression(&info);
  jpeg_start_compress(&info, TRUE);
  const std::size_t stride = static_cast<std::size_t>(width * info.input_components);
  while (info.next_scanline < info.image_height) {
    JSAMPROW row = const_cast<JSAMPROW>(samples.data() + info.next_scanline * stride);
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  jpeg_destroy_compress(&info);
  const std::byte* begin = reinterpret_cast<const std::byte*>(file);
  Bytes bytes(begin, begin + size);
  std::free(file);
  return bytes;
}

void write_file(const std::filesystem::path& path, std::span<const std::byte> bytes) {
  std::filesystem::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

Bytes read_file(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(file)), {});
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

}  // namespace stillmap::test
