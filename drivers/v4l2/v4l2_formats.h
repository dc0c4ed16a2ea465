// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <linux/videodev2.h>

#include <array>
#include <string>
#include <string_view>

#include "drivers/pictures/raw_picture.h"

namespace stillmap {

struct V4l2Format {
  std::uint32_t fourcc;
  PixelFormat format;
  bool own_chroma_plane = false;
};

inline std::string fourcc_text(std::uint32_t fourcc) {
  std::string text(4, ' ');
  for (int i = 0; i < 4; ++i) text[static_cast<std::size_t>(i)] = static_cast<char>(fourcc >> (8 * i));
  return text;
}
/// "Z16" is the same as the kernel's "Z16 ".
inline bool is_named(std::uint32_t fourcc, std::string_view name) {
  std::string padded(name);
  padded.resize(4, ' ');
  return name.size() <= 4 && fourcc_text(fourcc) == padded;
}

/// What can be used as colour, the best first: uncompressed before JPEG, colour before grey.
constexpr std::array<V4l2Format, 7> kV4l2Colours{{{V4L2_PIX_FMT_YUYV, PixelFormat::Yuyv},
                                                  {V4L2_PIX_FMT_NV12, PixelFormat::Nv12},
                                                  {V4L2_PIX_FMT_NV12M, PixelFormat::Nv12, true},
                                                  {V4L2_PIX_FMT_BGR24, PixelFormat::Bgr},
                                                  {V4L2_PIX_FMT_RGB24, PixelFormat::Rgb},
                                                  {V4L2_PIX_FMT_MJPEG, PixelFormat::Mjpg},
                                                  {V4L2_PIX_FMT_GREY, PixelFormat::Grey}}};
constexpr std::array<V4l2Format, 2> kV4l2Depths{
    {{V4L2_PIX_FMT_Z16, PixelFormat::Depth16}, {V4L2_PIX_FMT_Y16, PixelFormat::Depth16}}};

}  // namespace stillmap
