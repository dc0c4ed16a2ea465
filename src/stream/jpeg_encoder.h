// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "core/arena.h"
#include "core/image.h"

namespace stillmap::stream {

/// Pictures of one size to baseline JPEG with libjpeg-turbo. One thread; no heap after construction: what the
/// library asks for comes from the arena.
class JpegEncoder {
 public:
  /// With a planning arena that is all it is good for.
  JpegEncoder(Arena& arena, int width, int height);
  ~JpegEncoder();
  JpegEncoder(const JpegEncoder&) = delete;
  JpegEncoder& operator=(const JpegEncoder&) = delete;

  /// Returns the bytes written; 0 when they do not fit into `out`. `quality` 1 to 100.
  std::size_t encode(ImageView<const Bgr> picture, int quality, std::span<std::uint8_t> out);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace stillmap::stream
