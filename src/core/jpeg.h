// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "core/image.h"
#include "core/scratch.h"

namespace stillmap {

enum class DecodeStatus : std::uint8_t {
  Ok,
  Corrupt,   ///< damaged, cut short, or another kind of picture; the view may be half written
  WrongSize  ///< another size than the view's, which is untouched
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

/// Pictures of one size to baseline JPEG. The library gets what it asks for from the given memory; nothing is
/// taken from the heap after construction. One thread.
class JpegEncoder {
 public:
  /// What pictures of this width need, px.
  static std::size_t memory_bytes(int width);
  /// `memory` has memory_bytes at least.
  JpegEncoder(Scratch memory, int width, int height);
  ~JpegEncoder();

  /// Returns the bytes written; 0 where they do not fit into `out`, or the picture has another size.
  /// `quality` from 1 to 100.
  std::size_t encode(ImageView<const Bgr> picture, int quality, std::span<std::byte> out);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace stillmap
