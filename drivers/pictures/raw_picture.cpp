// SPDX-License-Identifier: Apache-2.0
#include "drivers/pictures/raw_picture.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace stillmap {

namespace {

static_assert(std::endian::native == std::endian::little, "depth is read as it lies in the camera's buffer");

std::uint8_t clamped(int v) {
  return static_cast<std::uint8_t>(std::clamp(v, 0, 255));
}

/// BT.601, studio range, in 8-bit fixed point.
struct Chroma {
  Chroma(int u, int v)
      : b(516 * (u - 128) + 128), g(-100 * (u - 128) - 208 * (v - 128) + 128), r(409 * (v - 128) + 128) {}
  Bgr with(int y) const {
    const int luma = 298 * (y - 16);
    return {clamped((luma + b) >> 8), clamped((luma + g) >> 8), clamped((luma + r) >> 8)};
  }
  int b, g, r;
};

void yuyv_row(const std::uint8_t* from, Bgr* to, int width) {
  for (int x = 0; x + 1 < width; x += 2, from += 4) {
    const Chroma chroma(from[1], from[3]);
    to[x] = chroma.with(from[0]);
    to[x + 1] = chroma.with(from[2]);
  }
}

void nv12_row(const std::uint8_t* luma, const std::uint8_t* uv, Bgr* to, int width) {
  for (int x = 0; x + 1 < width; x += 2) {
    const Chroma chroma(uv[x], uv[x + 1]);
    to[x] = chroma.with(luma[x]);
    to[x + 1] = chroma.with(luma[x + 1]);
  }
}

void rgb_row(const std::uint8_t* from, Bgr* to, int width) {
  for (int x = 0; x < width; ++x, from += 3) to[x] = {from[2], from[1], from[0]};
}

void grey_row(const std::uint8_t* from, Bgr* to, int width) {
  for (int x = 0; x < width; ++x) to[x] = {from[x], from[x], from[x]};
}

/// Pixels that share their chroma come in pairs, of rows too where the format says so.
bool has_whole_pairs(const RawPicture& p) {
  if (p.format != PixelFormat::Yuyv && p.format != PixelFormat::Nv12) return true;
  return p.width % 2 == 0 && (p.format == PixelFormat::Yuyv || p.height % 2 == 0);
}

/// Rows of the first plane, counting chroma that follows in the same plane.
std::size_t plane_rows(PixelFormat format, int height) {
  const std::size_t rows = static_cast<std::size_t>(height);
  return format == PixelFormat::Nv12 ? rows + rows / 2 : rows;
}

/// The last row may be short of its padding.
std::size_t least_bytes(std::size_t rows, std::size_t stride, std::size_t row) {
  return (rows - 1) * stride + row;
}

bool is_complete(const RawPicture& p) {
  const std::size_t row = row_bytes(p.format, p.width);
  const auto holds = [&](const RawPicture::Plane& plane, std::size_t rows) {
    return plane.data != nullptr && plane.stride_bytes >= row &&
           plane.bytes >= least_bytes(rows, plane.stride_bytes, row);
  };
  if (p.format != PixelFormat::Nv12 || p.planes[1].data == nullptr)
    return holds(p.planes[0], plane_rows(p.format, p.height));
  const auto rows = static_cast<std::size_t>(p.height);
  return holds(p.planes[0], rows) && holds(p.planes[1], rows / 2);
}

}  // namespace

std::size_t row_bytes(PixelFormat format, int width) {
  const auto pixels = static_cast<std::size_t>(width);
  switch (format) {
    case PixelFormat::Yuyv:
    case PixelFormat::Depth16:
      return 2 * pixels;
    case PixelFormat::Rgb:
    case PixelFormat::Bgr:
      return 3 * pixels;
    case PixelFormat::Nv12:
    case PixelFormat::Grey:
      return pixels;
    case PixelFormat::Mjpg:
      return 0;
  }
  return 0;
}

std::size_t picture_bytes(PixelFormat format, int height, std::size_t stride_bytes) {
  return format == PixelFormat::Mjpg ? 0 : plane_rows(format, height) * stride_bytes;
}

ColourConverter::ColourConverter(PixelFormat format, int width, int height) {
  if (format == PixelFormat::Mjpg) jpeg_.emplace(width, height, JpegDecoder::Source::Camera);
}

DecodeStatus ColourConverter::convert(const RawPicture& from, ImageView<Bgr> into) {
  const RawPicture::Plane& plane = from.planes[0];
  if (from.format == PixelFormat::Mjpg)
    return jpeg_ ? jpeg_->decode_colour({plane.data, plane.bytes}, into) : DecodeStatus::Corrupt;
  if (from.width != into.width || from.height != into.height) return DecodeStatus::WrongSize;
  if (!has_whole_pairs(from) || from.format == PixelFormat::Depth16 || !is_complete(from))
    return DecodeStatus::Corrupt;
  const auto* pixels = reinterpret_cast<const std::uint8_t*>(plane.data);
  const bool own_plane = from.planes[1].data != nullptr;
  const auto* chroma = own_plane ? reinterpret_cast<const std::uint8_t*>(from.planes[1].data)
                                 : pixels + static_cast<std::size_t>(from.height) * plane.stride_bytes;
  const std::size_t chroma_stride = own_plane ? from.planes[1].stride_bytes : plane.stride_bytes;
  for (int y = 0; y < from.height; ++y) {
    const std::uint8_t* row = pixels + static_cast<std::size_t>(y) * plane.stride_bytes;
    Bgr* to = into.row(y);
    switch (from.format) {
      case PixelFormat::Yuyv:
        yuyv_row(row, to, from.width);
        break;
      case PixelFormat::Nv12:
        nv12_row(row, chroma + static_cast<std::size_t>(y / 2) * chroma_stride, to, from.width);
        break;
      case PixelFormat::Rgb:
        rgb_row(row, to, from.width);
        break;
      case PixelFormat::Bgr:
        std::memcpy(to, row, row_bytes(from.format, from.width));
        break;
      case PixelFormat::Grey:
        grey_row(row, to, from.width);
        break;
      case PixelFormat::Mjpg:
      case PixelFormat::Depth16:
        break;
    }
  }
  return DecodeStatus::Ok;
}

DecodeStatus depth_view(const RawPicture& from, ImageView<const std::uint16_t>& out) {
  const RawPicture::Plane& plane = from.planes[0];
  if (from.format != PixelFormat::Depth16 || !is_complete(from) || plane.stride_bytes % 2 != 0)
    return DecodeStatus::Corrupt;
  out = {reinterpret_cast<const std::uint16_t*>(plane.data), from.width, from.height,
         static_cast<int>(plane.stride_bytes / 2)};
  return DecodeStatus::Ok;
}

}  // namespace stillmap
