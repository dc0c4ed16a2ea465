// SPDX-License-Identifier: Apache-2.0
#include <csetjmp>
#include <cstdio>
#include <memory>
// jpeglib.h needs <cstdio> before it, which sorting would undo.
// clang-format off
#include <jpeglib.h>
// clang-format on

#include "tests/support/synthetic_log/image_files.h"

namespace stillmap::synthetic {

namespace {

struct ErrorHandler {
  jpeg_error_mgr base;  ///< first, so that the library's pointer to it is a pointer to this
  std::jmp_buf back;
};

/// The library's own way out of a fatal error is to end the process.
[[noreturn]] void leave(j_common_ptr jpeg) {
  std::longjmp(reinterpret_cast<ErrorHandler*>(jpeg->err)->back, 1);
}

/// Only plain C objects live here: longjmp runs no destructors.
bool compress(std::FILE* out, ImageView<const Bgr> image, int quality) {
  jpeg_compress_struct jpeg{};
  ErrorHandler handler{};
  jpeg.err = jpeg_std_error(&handler.base);
  handler.base.error_exit = leave;
  if (setjmp(handler.back) != 0) {
    jpeg_destroy_compress(&jpeg);
    return false;
  }
  jpeg_create_compress(&jpeg);
  jpeg_stdio_dest(&jpeg, out);
  jpeg.image_width = static_cast<JDIMENSION>(image.width);
  jpeg.image_height = static_cast<JDIMENSION>(image.height);
  jpeg.input_components = 3;
  jpeg.in_color_space = JCS_EXT_BGR;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, quality, TRUE);
  jpeg_start_compress(&jpeg, TRUE);
  while (jpeg.next_scanline < jpeg.image_height) {
    // The library takes rows as mutable, and does not change them.
    auto* row = reinterpret_cast<JSAMPROW>(const_cast<Bgr*>(image.row(static_cast<int>(jpeg.next_scanline))));
    jpeg_write_scanlines(&jpeg, &row, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  return true;
}

}  // namespace

bool write_jpeg(const std::filesystem::path& file, ImageView<const Bgr> image, int quality) {
  const std::unique_ptr<std::FILE, decltype(&std::fclose)> out(std::fopen(file.c_str(), "wb"), &std::fclose);
  return out != nullptr && compress(out.get(), image, quality) && std::fflush(out.get()) == 0;
}

}  // namespace stillmap::synthetic
