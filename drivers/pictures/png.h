// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "core/image.h"
#include "core/jpeg.h"

namespace stillmap {

/// Decodes PNG files from memory straight into a view. All of the library's memory is made here, at
/// construction. One thread.
class PngDecoder {
 public:
  PngDecoder();
  ~PngDecoder();
  static bool is_png(std::span<const std::byte> file);
  /// RGB, RGBA, grey or palette, 8 bits or less a channel, alpha ignored.
  DecodeStatus decode_colour(std::span<const std::byte> file, ImageView<Bgr> into);
  /// 16-bit grey, readings as they are.
  DecodeStatus decode_depth(std::span<const std::byte> file, ImageView<std::uint16_t> into);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Encodes PNG files into a buffer of its own, at the fastest level: pixels stay exact. All memory is made
/// here, at construction, for pictures of the given size. One thread.
class PngEncoder {
 public:
  PngEncoder(int width, int height);
  ~PngEncoder();
  /// The file, valid until the next call; empty where the picture is larger than the encoder was made for.
  std::span<const std::byte> encode_colour(ImageView<const Bgr> picture);
  /// 16-bit grey.
  std::span<const std::byte> encode_depth(ImageView<const std::uint16_t> picture);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace stillmap
