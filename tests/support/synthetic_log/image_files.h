// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>

#include "core/image.h"

namespace stillmap::synthetic {

/// Each writes one file; false when that failed. The bytes depend on the pixels alone.
bool write_png_grey8(const std::filesystem::path& file, ImageView<const std::uint8_t> image);
bool write_png_grey16(const std::filesystem::path& file, ImageView<const std::uint16_t> image);

}  // namespace stillmap::synthetic
