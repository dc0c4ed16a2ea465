// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "core/image.h"

namespace stillmap {

enum class DecodeStatus : std::uint8_t {
  Ok,
  Corrupt,   ///< damaged, cut short, or another kind of picture; the view may be half written
  WrongSize  ///< another size than the view's, which is untouched
};

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

/// Decodes JPEG files (baseline or progressive; colour or grey) from memory straight into a view. All of the
/// library's memory is made here, at construction, enough for progressive pictures of the given size. One
/// thread.
class JpegDecoder {
 public:
  /// Many cameras pad a picture with bytes that mean nothing; in a file those are damage.
  enum class Source : std::uint8_t { File, Camera };
  JpegDecoder(int width, int height, Source source = Source::File);
  ~JpegDecoder();
  DecodeStatus decode_colour(std::span<const std::byte> file, ImageView<Bgr> into);

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

/// Encodes baseline JPEG files into a buffer of its own; otherwise as PngEncoder.
class JpegEncoder {
 public:
  /// `quality` from 1 to 100.
  JpegEncoder(int width, int height, int quality);
  ~JpegEncoder();
  std::span<const std::byte> encode_colour(ImageView<const Bgr> picture);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace stillmap
