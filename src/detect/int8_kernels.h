// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace stillmap {

/// What follows the sum of a quantized convolution: round(multiplier * sum) + zero, cut to 8 bits, looked up.
struct Requantize {
  const std::int32_t* bias;  ///< a sum's start, one per output channel
  const float* multiplier;   ///< one per output channel
  int zero;                  ///< the output's zero point
  const std::int8_t* lut;    ///< 256 values of the activation, from that of -128 on; null: none
};

/// A matrix product: out[o][x] from the sum over k of weight[o][k] * in[k][x].
struct DenseJob {
  const std::int8_t* in;  ///< `depth` rows of `columns`, one after the other
  int depth, columns, outputs;
  const std::int32_t* weights;  ///< [output / tile][depth / channels_per_lane][tile]
  bool whole_range;             ///< a weight of -128 is among them
  Requantize after;
  std::int8_t* out;       ///< `outputs` rows of `columns`, one after the other
  std::int32_t* scratch;  ///< kDenseBlock for every channels_per_lane of depth, 64-byte aligned
};
constexpr int kDenseBlock = 64;  ///< columns at a time

/// A convolution of each channel on its own.
struct DepthwiseJob {
  const std::int8_t* in;  ///< `channels` planes of `height` rows of `width`
  int channels, width, height, out_width, out_height;
  int kernel_width, kernel_height, stride, pad_x, pad_y;
  int in_zero;           ///< what lies around the picture
  const float* weights;  ///< whole numbers, [channel][row][column]
  Requantize after;
  std::int8_t* out;  ///< `channels` planes of `out_height` rows of `out_width`
  /// 64-byte aligned: scratch_rows * stride rows of scratch_pitch floats, the channel with its margins, and
  /// after them kDepthwiseRows rows of bytes, as long as the output's up to whole kDepthwiseColumns.
  float* scratch;
  std::size_t scratch_pitch;
  int scratch_rows;
};
/// Rows and columns that a depthwise kernel makes at once, and the most weights of a channel.
constexpr int kDepthwiseRows = 4, kDepthwiseColumns = 16, kMostTaps = 64;

/// The arithmetic of quantized convolutions for one instruction set. All sets give the same bytes: sums are
/// whole numbers without overflow (depthwise ones below 2^24 as floats), and rounding is to the nearest, ties
/// to even. Threads do not matter; no heap.
struct Int8Kernels {
  const char* name;
  int channels_per_lane;  ///< weights in one 32-bit word: 4 of 8 bits, or 2 of 16 bits
  int tile;               ///< output channels side by side
  int input_offset;       ///< added to inputs: the bias must have this times the sum of weights less
  void (*dense)(const DenseJob&);
  void (*depthwise)(const DepthwiseJob&);
};

namespace isa_generic {
extern const Int8Kernels kernels;
}
#ifdef __x86_64__
namespace isa_avx2 {
extern const Int8Kernels kernels;
}
namespace isa_avx512 {
extern const Int8Kernels kernels;
}
#endif
#ifdef __aarch64__
namespace isa_dotprod {
extern const Int8Kernels kernels;
}
#endif

}  // namespace stillmap
