// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace stillmap {

struct Bgr {
  std::uint8_t b = 0, g = 0, r = 0;
};

/// Luma after BT.601, as every grey conversion that descriptors were ever measured on.
constexpr std::uint8_t luma(Bgr c) {
  return static_cast<std::uint8_t>((c.b * 29 + c.g * 150 + c.r * 77 + 128) >> 8);
}

/// A view of pixels that somebody else owns. `stride` counts pixels from one row to the next.
template <class T>
struct ImageView {
  T* data = nullptr;
  int width = 0, height = 0, stride = 0;

  T* row(int y) const { return data + static_cast<std::ptrdiff_t>(y) * stride; }
  T& at(int x, int y) const { return row(y)[x]; }
  bool contains(int x, int y) const { return x >= 0 && y >= 0 && x < width && y < height; }
  /// Converts as T* does to const T*.
  operator ImageView<const T>() const  // NOLINT(google-explicit-constructor)
      requires(!std::is_const_v<T>) {
    return {data, width, height, stride};
  }
};

}  // namespace stillmap
