// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>

namespace stillmap {

struct PictureSize {
  int width = 0, height = 0;
  bool operator==(const PictureSize&) const = default;
};

/// What the head of a PNG or JPEG file says of its size, in pixels; none where it is neither, or is cut off
/// before that. PNG: IHDR, first chunk; JPEG: ITU-T T.81, B.2.2.
std::optional<PictureSize> picture_size(std::span<const std::byte> file);

}  // namespace stillmap
