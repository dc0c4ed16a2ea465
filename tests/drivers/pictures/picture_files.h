// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

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
void write_text(const std::filesystem::path& path, const std::string& text);
Bytes read_file(const std::filesystem::path& path);

/// A folder of its own that goes away with the object.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace stillmap::test
