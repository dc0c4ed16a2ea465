// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string_view>

namespace stillmap {

/// One output of a network; the memory is the network's, valid until its next run.
struct Tensor {
  std::string_view name;       ///< without the prefixes of importer and quantizer
  int dimensions = 0;          ///< 0: it has more than four, or is not made of floats
  std::array<int, 4> shape{};  ///< the first `dimensions` count
  std::span<const float> values;

  std::size_t size(std::size_t axis) const { return static_cast<std::size_t>(shape[axis]); }
};

}  // namespace stillmap
