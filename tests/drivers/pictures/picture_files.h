// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace stillmap::test {

using Bytes = std::vector<std::byte>;

enum class PngKind { Grey8, Grey16, Rgb8, Rgba8, Palette8 };
struct PngOptions {
  bool interlaced = false;
  std::string text;  ///< a text chunk, where not empty
};

/// The PNG file of `samples`, one number a channel, rows from the top. A palette maps index i to (i, 255 - i,
/// 7).
Bytes png_file(PngKind kind, int width, int height, std::span<const std::uint16_t> samples,
               PngOptions options = {});

enum class JpegKind { Grey, Colour, ProgressiveColour };
/// The JPEG file (quality 100, no chroma subsampling) of `samples`, red green blue or grey, rows from the
/// top.
Bytes jpeg_file(JpegKind kind, int width, int height, std::span<const std::uint8_t> samples);

void write_file(const std::filesystem::path& path, std::span<const std::byte> bytes);
Bytes read_file(const std::filesystem::path& path);

}  // namespace stillmap::test
