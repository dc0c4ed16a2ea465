// SPDX-License-Identifier: Apache-2.0
#include "drivers/pictures/picture_size.h"

#include "drivers/pictures/png.h"

namespace stillmap {

namespace {

int big_endian(std::span<const std::byte> file, std::size_t at, std::size_t bytes) {
  int value = 0;
  for (const std::byte b : file.subspan(at, bytes)) value = value << 8 | std::to_integer<int>(b);
  return value;
}

bool begins_a_frame(int marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

}  // namespace

std::optional<PictureSize> picture_size(std::span<const std::byte> file) {
  if (PngDecoder::is_png(file)) {
    if (file.size() < 24 || file[16] != std::byte{0} || file[20] != std::byte{0}) return std::nullopt;
    return PictureSize{big_endian(file, 16, 4), big_endian(file, 20, 4)};
  }
  if (file.size() < 2 || big_endian(file, 0, 2) != 0xFFD8) return std::nullopt;
  for (std::size_t at = 2; at + 9 <= file.size() && file[at] == std::byte{0xFF};) {
    const int marker = big_endian(file, at + 1, 1);
    if (begins_a_frame(marker)) return PictureSize{big_endian(file, at + 7, 2), big_endian(file, at + 5, 2)};
    at += 2 + static_cast<std::size_t>(big_endian(file, at + 2, 2));
  }
  return std::nullopt;
}

}  // namespace stillmap
