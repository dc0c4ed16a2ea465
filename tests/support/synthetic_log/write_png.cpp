// SPDX-License-Identifier: Apache-2.0
#include <spng.h>

#include <cstdio>
#include <memory>

#include "core/check.h"
#include "tests/support/synthetic_log/image_files.h"

namespace stillmap::synthetic {

namespace {

/// `pixels` are rows without gaps, in this machine's byte order.
bool write_grey(const std::filesystem::path& file, const void* pixels, int width, int height, int bits) {
  const std::unique_ptr<spng_ctx, decltype(&spng_ctx_free)> png(spng_ctx_new(SPNG_CTX_ENCODER),
                                                                &spng_ctx_free);
  const std::unique_ptr<std::FILE, decltype(&std::fclose)> out(std::fopen(file.c_str(), "wb"), &std::fclose);
  if (png == nullptr || out == nullptr) return false;
  spng_ihdr header{};
  header.width = static_cast<std::uint32_t>(width);
  header.height = static_cast<std::uint32_t>(height);
  header.bit_depth = static_cast<std::uint8_t>(bits);
  header.color_type = SPNG_COLOR_TYPE_GRAYSCALE;
  const std::size_t bytes =
      static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * static_cast<std::size_t>(bits) / 8;
  // Noise hardly compresses: the fastest level is 1.3 times the bytes of the best one at a fifth of its time.
  return spng_set_png_file(png.get(), out.get()) == 0 && spng_set_ihdr(png.get(), &header) == 0 &&
         spng_set_option(png.get(), SPNG_IMG_COMPRESSION_LEVEL, 1) == 0 &&
         spng_set_option(png.get(), SPNG_FILTER_CHOICE, SPNG_FILTER_CHOICE_SUB) == 0 &&
         spng_encode_image(png.get(), pixels, bytes, SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE) == 0 &&
         std::fflush(out.get()) == 0;
}

}  // namespace

bool write_png_grey8(const std::filesystem::path& file, ImageView<const std::uint8_t> image) {
  STILLMAP_CHECK(image.stride == image.width);
  return write_grey(file, image.data, image.width, image.height, 8);
}

bool write_png_grey16(const std::filesystem::path& file, ImageView<const std::uint16_t> image) {
  STILLMAP_CHECK(image.stride == image.width);
  return write_grey(file, image.data, image.width, image.height, 16);
}

}  // namespace stillmap::synthetic
