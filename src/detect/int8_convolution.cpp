// SPDX-License-Identifier: Apache-2.0
#include "detect/int8_convolution.h"

#include <algorithm>

#ifdef __aarch64__
#include <sys/auxv.h>
#endif

#include "core/check.h"
#include "core/vector_clones.h"

namespace stillmap {

namespace {

constexpr std::size_t kAlignment = 64;

std::byte* aligned(std::span<std::byte> memory) {
  const std::size_t past = reinterpret_cast<std::uintptr_t>(memory.data()) % kAlignment;
  return memory.data() + (kAlignment - past) % kAlignment;
}

template <class T>
T round_up(T value, T step) {
  return (value + step - 1) / step * step;
}

std::size_t size(int a, int b, int c = 1) {
  return static_cast<std::size_t>(a) * static_cast<std::size_t>(b) * static_cast<std::size_t>(c);
}

/// `count` values, `step` apart.
STILLMAP_VECTOR_CLONES void take_every(const std::int8_t* from, int step, int count, std::int8_t* out) {
  if (step == 1) {
    std::copy_n(from, count, out);
  } else if (step == 2) {
    for (int i = 0; i < count; ++i) out[i] = from[2 * i];
  } else {
    for (int i = 0; i < count; ++i) out[i] = from[i * step];
  }
}

/// One 32-bit word of the weights of channels side by side.
std::int32_t word_of(std::span<const std::int8_t> channels, int per_lane) {
  std::uint32_t word = 0;
  const int bits = 32 / per_lane;
  const std::uint32_t mask = (1u << bits) - 1;
  for (std::size_t i = 0; i < channels.size(); ++i)
    word |= (static_cast<std::uint32_t>(channels[i]) & mask) << (bits * static_cast<int>(i));
  return static_cast<std::int32_t>(word);
}

}  // namespace

std::span<const Int8Kernels* const> int8_kernels() {
  static const std::vector<const Int8Kernels*> found = [] {
    std::vector<const Int8Kernels*> list;
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vnni") &&
        __builtin_cpu_supports("avx512vbmi"))
      list.push_back(&isa_avx512::kernels);
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) list.push_back(&isa_avx2::kernels);
#endif
#ifdef __aarch64__
    if ((getauxval(AT_HWCAP) & HWCAP_ASIMDDP) != 0) list.push_back(&isa_dotprod::kernels);
#endif
    list.push_back(&isa_generic::kernels);
    return list;
  }();
  return found;
}

bool Int8Convolution::can(const Shape& s) {
  const bool whole = s.in_channels > 0 && s.out_channels > 0 && s.kernel_width > 0 && s.kernel_height > 0 &&
                     s.stride > 0 && s.pad_x >= 0 && s.pad_y >= 0;
  if (!whole) return false;
  if (s.depthwise)
    return s.in_channels == s.out_channels && s.stride <= 4 && s.kernel_width * s.kernel_height <= kMostTaps;
  // The sum of products of 8 bits stays within 32.
  return size(s.in_channels, s.kernel_width, s.kernel_height) <= 65536;
}

Int8Convolution::Int8Convolution(const Int8Kernels& kernels, const Shape& shape,
                                 std::span<const std::int8_t> weights, std::span<const std::int32_t> bias,
                                 std::span<const float> multiplier, int in_zero, int out_zero)
    : kernels_(&kernels),
      shape_(shape),
      in_zero_(in_zero),
      out_zero_(out_zero),
      whole_range_(std::find(weights.begin(), weights.end(), -128) != weights.end()),
      bias_(bias.begin(), bias.end()),
      multiplier_(multiplier.begin(), multiplier.end()) {
  const std::size_t outputs = size(shape.out_channels, 1);
  const std::size_t depth =
      size(shape.depthwise ? 1 : shape.in_channels, shape.kernel_width, shape.kernel_height);
  STILLMAP_CHECK(can(shape) && weights.size() == outputs * depth && bias.size() == outputs &&
                 multiplier.size() == outputs);
  if (shape.depthwise) {
    depthwise_weights_.assign(weights.begin(), weights.end());
    return;
  }
  const auto per_lane = static_cast<std::size_t>(kernels.channels_per_lane);
  const auto tile = static_cast<std::size_t>(kernels.tile);
  const std::size_t groups = round_up(depth, per_lane) / per_lane;
  dense_weights_.assign(round_up(outputs, tile) * groups, 0);
  for (std::size_t o = 0; o < outputs; ++o) {
    const auto row = weights.subspan(o * depth, depth);
    for (std::size_t g = 0; g < groups; ++g) {
      const auto channels = row.subspan(g * per_lane, std::min(per_lane, depth - g * per_lane));
      dense_weights_[(o / tile * groups + g) * tile + o % tile] =
          word_of(channels, kernels.channels_per_lane);
    }
    for (const std::int8_t w : row) bias_[o] -= kernels.input_offset * w;
  }
}

Requantize Int8Convolution::after() const {
  return {bias_.data(), multiplier_.data(), out_zero_, lut_.empty() ? nullptr : lut_.data()};
}

bool Int8Convolution::pointwise() const {
  return shape_.kernel_width * shape_.kernel_height == 1 && shape_.stride == 1 && shape_.pad_x == 0 &&
         shape_.pad_y == 0;
}

std::size_t Int8Convolution::packed_bytes() const {
  const int depth = shape_.in_channels * shape_.kernel_width * shape_.kernel_height;
  const int per_lane = kernels_->channels_per_lane;
  return size((depth + per_lane - 1) / per_lane, kDenseBlock, sizeof(std::int32_t));
}

Int8Convolution::Rows Int8Convolution::depthwise_rows(int in_width, int in_height) const {
  const int columns =
      round_up(out_width(in_width), kDepthwiseColumns) + (shape_.kernel_width - 1) / shape_.stride;
  const int rows =
      (round_up(out_height(in_height), kDepthwiseRows) - 1) * shape_.stride + shape_.kernel_height;
  return {size(round_up(columns, kDepthwiseColumns), 1), rows};
}

std::size_t Int8Convolution::scratch_bytes(int in_width, int in_height) const {
  if (shape_.depthwise) {
    const Rows rows = depthwise_rows(in_width, in_height);
    return kAlignment + rows.pitch * (size(rows.count, shape_.stride, sizeof(float)) + kDepthwiseRows);
  }
  const std::size_t unrolled = size(shape_.in_channels, shape_.kernel_width, shape_.kernel_height) *
                               size(out_width(in_width), out_height(in_height));
  return kAlignment + packed_bytes() + (pointwise() ? 0 : unrolled);
}

void Int8Convolution::run(const std::int8_t* in, int width, int height, std::int8_t* out,
                          std::span<std::byte> scratch) const {
  STILLMAP_CHECK(scratch.size() >= scratch_bytes(width, height));
  if (shape_.depthwise) {
    run_depthwise(in, width, height, out, aligned(scratch));
  } else {
    run_dense(in, width, height, out, aligned(scratch));
  }
}

void Int8Convolution::run_depthwise(const std::int8_t* in, int width, int height, std::int8_t* out,
                                    std::byte* scratch) const {
  const Rows rows = depthwise_rows(width, height);
  kernels_->depthwise({in, shape_.in_channels, width, height, out_width(width), out_height(height),
                       shape_.kernel_width, shape_.kernel_height, shape_.stride, shape_.pad_x, shape_.pad_y,
                       in_zero_, depthwise_weights_.data(), after(), out, reinterpret_cast<float*>(scratch),
                       rows.pitch, rows.count});
}

std::int8_t* Int8Convolution::unroll(const std::int8_t* in, int width, int height, int k,
                                     std::int8_t* to) const {
  const int kx = k % shape_.kernel_width, ky = k / shape_.kernel_width % shape_.kernel_height;
  const std::int8_t* plane = in + size(k / shape_.kernel_width / shape_.kernel_height, width, height);
  const int columns = out_width(width), stride = shape_.stride, shift = shape_.pad_x - kx;
  // Output columns from `first` to `end` see the picture.
  const int end = std::clamp((width + shift + stride - 1) / stride, 0, columns);
  const int first = std::clamp((shift + stride - 1) / stride, 0, end);
  const auto zero = static_cast<std::int8_t>(in_zero_);
  for (int y = 0; y < out_height(height); ++y, to += columns) {
    const int from_y = y * stride + ky - shape_.pad_y;
    if (from_y < 0 || from_y >= height) {
      std::fill_n(to, columns, zero);
      continue;
    }
    const std::int8_t* row = plane + size(from_y, width);
    std::fill_n(to, first, zero);
    take_every(row + first * stride - shift, stride, end - first, to + first);
    std::fill_n(to + end, columns - end, zero);
  }
  return to;
}

void Int8Convolution::run_dense(const std::int8_t* in, int width, int height, std::int8_t* out,
                                std::byte* scratch) const {
  const int columns = out_width(width) * out_height(height);
  const int depth = shape_.in_channels * shape_.kernel_width * shape_.kernel_height;
  const std::int8_t* rows = in;
  if (!pointwise()) {
    auto* unrolled = reinterpret_cast<std::int8_t*>(scratch + packed_bytes());
    rows = unrolled;
    for (int k = 0; k < depth; ++k) unrolled = unroll(in, width, height, k, unrolled);
  }
  kernels_->dense({rows, depth, columns, shape_.out_channels, dense_weights_.data(), whole_range_, after(),
                   out, reinterpret_cast<std::int32_t*>(scratch)});
}

}  // namespace stillmap
