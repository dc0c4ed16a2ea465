// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace stillmap {

/// Planes of rows of numbers, one after the other.
struct TensorShape {
  int channels = 0, height = 0, width = 0;
  std::size_t plane() const { return static_cast<std::size_t>(height) * static_cast<std::size_t>(width); }
  std::size_t size() const { return static_cast<std::size_t>(channels) * plane(); }
  bool operator==(const TensorShape&) const = default;
};

/// The plain layers between quantized convolutions. All work on tensors of 8 bits that do not overlap, take
/// no heap memory, and may be used by any thread.

/// The largest in each square of `size` x `size`, every `stride`; what lies around the picture does not
/// count.
struct MaxPool {
  int size = 1, stride = 1, pad = 0;
  TensorShape shape_of(const TensorShape& in) const {
    return {in.channels, (in.height + 2 * pad - size) / stride + 1, (in.width + 2 * pad - size) / stride + 1};
  }
  void run(const TensorShape& shape, const std::int8_t* in, std::int8_t* out) const;
};

/// Twice as high and wide, interpolated between the middles of the pixels; fractions are cut off, as OpenCV
/// does it.
struct Doubling {
  static TensorShape shape_of(const TensorShape& in) { return {in.channels, 2 * in.height, 2 * in.width}; }
  static void run(const TensorShape& shape, const std::int8_t* in, std::int8_t* out);
};

/// round(a_factor * a + b_factor * b + offset), cut to 8 bits; halves away from zero.
struct Sum {
  float a_factor = 1, b_factor = 1, offset = 0;
  void run(std::size_t count, const std::int8_t* a, const std::int8_t* b, std::int8_t* out) const;
};

/// Tensors of one scale behind each other.
struct Join {};

}  // namespace stillmap
