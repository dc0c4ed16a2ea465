// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "core/jpeg.h"

namespace stillmap {

/// How a camera lays out a picture's bytes. YUV is BT.601 in studio range, as webcams deliver it.
enum class PixelFormat : std::uint8_t {
  Yuyv,    ///< 4:2:2, Y U Y V
  Nv12,    ///< 4:2:0, a plane of Y and one of U V
  Rgb,     ///< 8 bits each, red first
  Bgr,     ///< 8 bits each, blue first
  Grey,    ///< 8 bits
  Mjpg,    ///< a JPEG file, also without Huffman tables
  Depth16  ///< 16 bits, little endian
};

/// Four letters, as Video4Linux calls it: "YUYV", "NV12", "RGB3", "BGR3", "GREY", "MJPG", "Z16".
inline const char* name_of(PixelFormat format) {
  switch (format) {
    case PixelFormat::Yuyv:
      return "YUYV";
    case PixelFormat::Nv12:
      return "NV12";
    case PixelFormat::Rgb:
      return "RGB3";
    case PixelFormat::Bgr:
      return "BGR3";
    case PixelFormat::Grey:
      return "GREY";
    case PixelFormat::Mjpg:
      return "MJPG";
    case PixelFormat::Depth16:
      return "Z16";
  }
  return "?";
}

/// A picture as it lies in a driver's buffer; somebody else owns the bytes.
struct RawPicture {
  struct Plane {
    const std::byte* data = nullptr;
    std::size_t bytes = 0;         ///< that hold something
    std::size_t stride_bytes = 0;  ///< from one row to the next
  };
  PixelFormat format = PixelFormat::Bgr;
  int width = 0, height = 0;
  std::array<Plane, 2> planes{};  ///< the second: Nv12's chroma, where it does not just follow the first
};

/// Bytes of a row's pixels in the first plane; 0 for Mjpg, which has no rows.
std::size_t row_bytes(PixelFormat format, int width);
/// Bytes that a whole picture of one plane needs at least; 0 for Mjpg.
std::size_t picture_bytes(PixelFormat format, int height, std::size_t stride_bytes);

/// Makes BGR of what cameras deliver. The memory that JPEG needs is made here, at construction. One thread.
class ColourConverter {
 public:
  ColourConverter(PixelFormat format, int width, int height);
  /// Corrupt where the buffer is too short, damaged or no colour picture; WrongSize where it is another size
  /// than the view's.
  DecodeStatus convert(const RawPicture& from, ImageView<Bgr> into);

 private:
  std::optional<JpegDecoder> jpeg_;
};

/// The readings of a Depth16 picture as a view into its buffer; Corrupt where that is too short.
DecodeStatus depth_view(const RawPicture& from, ImageView<const std::uint16_t>& out);

}  // namespace stillmap
