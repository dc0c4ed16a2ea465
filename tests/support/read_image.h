// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/image.h"

namespace stillmap::test {

/// A picture that owns its pixels; empty (width 0) where the file could not be read.
template <class T>
struct Image {
  int width = 0, height = 0;
  std::vector<T> pixels;

  Image() = default;
  Image(int w, int h, T value = T{})
      : width(w), height(h), pixels(static_cast<std::size_t>(w) * static_cast<std::size_t>(h), value) {}
  ImageView<T> view() { return {pixels.data(), width, height, width}; }
  ImageView<const T> view() const { return {pixels.data(), width, height, width}; }
};

/// JPEG (.jpg) or PNG, 8 bits a channel.
Image<Bgr> read_colour(const std::filesystem::path& file);
/// 16-bit grey PNG, in the file's own units.
Image<std::uint16_t> read_depth(const std::filesystem::path& file);
/// 8-bit grey PNG.
Image<std::uint8_t> read_grey(const std::filesystem::path& file);

/// The pictures of one moment of a log in the TUM layout.
struct RgbdFiles {
  std::filesystem::path colour, depth;
};
/// All lines of `folder`/associations.txt; empty where it is missing.
std::vector<RgbdFiles> list_rgbd(const std::filesystem::path& folder);

}  // namespace stillmap::test
