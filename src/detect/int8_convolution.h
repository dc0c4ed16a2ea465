// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "detect/int8_kernels.h"

namespace stillmap {

/// The kernels that this CPU can run, the fastest first.
std::span<const Int8Kernels* const> int8_kernels();

/// A quantized convolution, all channels with all or each on its own:
/// out = lut[cut(round(multiplier * (bias + sum of weight * in)) + zero)], with `in_zero` around the picture.
/// As OpenCV's ConvolutionInt8, which is several times slower (a depthwise one ten times), to the bit but
/// for ties of rounding. One thread at a time.
class Int8Convolution {
 public:
  struct Shape {
    int in_channels = 0, out_channels = 0;
    int kernel_width = 1, kernel_height = 1, stride = 1, pad_x = 0, pad_y = 0;
    bool depthwise = false;  ///< else every output channel sees every input channel
  };

  /// Whether this is a shape that run() can do.
  static bool can(const Shape& shape);

  /// `weights` [output][input of it][row][column]; `bias` holds less in_zero times the sum of weights.
  Int8Convolution(const Int8Kernels& kernels, const Shape& shape, std::span<const std::int8_t> weights,
                  std::span<const std::int32_t> bias, std::span<const float> multiplier, int in_zero,
                  int out_zero);

  /// The activation: 256 values, from that of -128 on.
  void set_lut(std::span<const std::int8_t> lut) { lut_.assign(lut.begin(), lut.end()); }
  bool has_lut() const { return !lut_.empty(); }

  int out_width(int in_width) const {
    return (in_width + 2 * shape_.pad_x - shape_.kernel_width) / shape_.stride + 1;
  }
  int out_height(int in_height) const {
    return (in_height + 2 * shape_.pad_y - shape_.kernel_height) / shape_.stride + 1;
  }

  /// What run() needs beside, for an input of this size.
  std::size_t scratch_bytes(int in_width, int in_height) const;
  /// `in` [channel][row][column], `out` alike, of another place in memory; `scratch` of scratch_bytes() or
  /// more. Takes no heap memory.
  void run(const std::int8_t* in, int width, int height, std::int8_t* out,
           std::span<std::byte> scratch) const;

 private:
  void run_dense(const std::int8_t* in, int width, int height, std::int8_t* out, std::byte* scratch) const;
  void run_depthwise(const std::int8_t* in, int width, int height, std::int8_t* out,
                     std::byte* scratch) const;
  bool pointwise() const;
  std::size_t packed_bytes() const;
  /// Of the rows that depthwise() works on.
  struct Rows {
    std::size_t pitch = 0;
    int count = 0;
  };
  Rows depthwise_rows(int in_width, int in_height) const;
  /// Writes what the k-th weight of every output sees, for every column; returns the place behind it.
  std::int8_t* unroll(const std::int8_t* in, int width, int height, int k, std::int8_t* to) const;
  Requantize after() const;

  const Int8Kernels* kernels_;
  Shape shape_;
  int in_zero_, out_zero_;
  bool whole_range_;  ///< a weight of -128 is among them
  std::vector<std::int32_t> dense_weights_;
  std::vector<float> depthwise_weights_;
  std::vector<std::int32_t> bias_;
  std::vector<float> multiplier_;
  std::vector<std::int8_t> lut_;
};

}  // namespace stillmap
