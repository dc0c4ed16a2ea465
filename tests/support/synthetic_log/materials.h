// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "tests/support/synthetic_log/texture.h"

namespace stillmap::synthetic {

/// Indices into what `make_materials` returns.
enum Material : int {
  kBrick,
  kPlaster,
  kFloor,
  kCeiling,
  kWood,
  kCarton,
  kMetal,
  kBooks,
  kScreen,
  kHazard,
  kVest,
  kTrousers,
  kShirt,
  kSkin,
  kHelmet,
  kShoe,
  kPoster,  ///< the first of kPosters different ones
};
constexpr int kPosters = 16;

std::vector<Texture> make_materials(std::uint64_t seed);

}  // namespace stillmap::synthetic
