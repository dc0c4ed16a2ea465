// SPDX-License-Identifier: Apache-2.0
// Compiled once for each instruction set (STILLMAP_ISA), so nothing here may call code that others share:
// the linker would keep one copy for all, perhaps the one that this CPU cannot run.
#include "detect/int8_kernels.h"

#include "detect/int8_vectors.h"

namespace stillmap::STILLMAP_ISA {

namespace {

/// kDenseBlock columns of every channel, lane by lane; what is beyond the input is 0.
void pack(const DenseJob& job, int first, int count) {
  const auto columns = static_cast<std::size_t>(job.columns);
  std::int32_t* to = job.scratch;
  for (int k = 0; k < job.depth; k += kPerLane, to += kDenseBlock) {
    const std::int8_t* from[kPerLane];
    std::int8_t rest[kPerLane][kDenseBlock];
    for (int i = 0; i < kPerLane; ++i) {
      from[i] = job.in + static_cast<std::size_t>(k + i) * columns + first;
      if (k + i < job.depth && count == kDenseBlock) continue;
      for (int x = 0; x < kDenseBlock; ++x)
        rest[i][x] = k + i < job.depth && x < count ? from[i][x] : std::int8_t{};
      from[i] = rest[i];
    }
    interleave(from, reinterpret_cast<std::int8_t*>(to));
  }
}

/// sums[tile][columns] of kWide vectors of columns.
template <bool whole_range>
inline void multiply(const std::int32_t* x, const std::int32_t* w, int lanes, std::int32_t* sums) {
  Sums acc = {};
  for (int lane = 0; lane < lanes; ++lane, x += kDenseBlock, w += kTile)
    multiply_lane<whole_range>(x, w, acc);
  for (int o = 0; o < kTile; ++o) {
    for (int v = 0; v < kWide; ++v) reinterpret_cast<Whole*>(sums + o * kDenseBlock)[v] = acc[o][v];
  }
}

template <bool whole_range>
void dense_of(const DenseJob& job) {
  const int lanes = (job.depth + kPerLane - 1) / kPerLane;
  alignas(64) std::int32_t sums[kTile * kDenseBlock] = {};
  alignas(64) std::int8_t bytes[kDenseBlock] = {};
  for (int first = 0; first < job.columns; first += kDenseBlock) {
    const int count = job.columns - first < kDenseBlock ? job.columns - first : kDenseBlock;
    pack(job, first, count);
    for (int o = 0; o < job.outputs; o += kTile) {
      const std::int32_t* weights = job.weights + static_cast<std::ptrdiff_t>(o) * lanes;
      for (int x = 0; x < count; x += kWide * kLanes)
        multiply<whole_range>(job.scratch + x, weights, lanes, sums + x);
      for (int t = 0; t < kTile && o + t < job.outputs; ++t) {
        for (int x = 0; x < count; x += 4 * kLanes) {
          Whole four[4];
          Bytes narrowed[4];
          for (int i = 0; i < 4; ++i)
            four[i] = reinterpret_cast<const Whole*>(sums + t * kDenseBlock + x)[i] + job.after.bias[o + t];
          narrow(four, job.after.multiplier[o + t], job.after.zero, narrowed);
          __builtin_memcpy(bytes + x, narrowed, sizeof narrowed);
        }
        if (job.after.lut != nullptr) look_up(bytes, job.after.lut);
        std::int8_t* out = job.out + static_cast<std::ptrdiff_t>(o + t) * job.columns + first;
        __builtin_memcpy(out, bytes, static_cast<std::size_t>(count));
      }
    }
  }
}

void dense(const DenseJob& job) {
  if (kAddsIn16Bits && job.whole_range) {
    dense_of<kAddsIn16Bits>(job);
  } else {
    dense_of<false>(job);
  }
}

/// Values as floats, one after the other.
inline void widen(const std::int8_t* from, int count, float* to) {
  int i = 0;
  for (; i + kWidened <= count; i += kWidened) widen_vector(from + i, to + i);
  if (i < count && count >= kWidened) {
    widen_vector(from + count - kWidened, to + count - kWidened);
    return;
  }
  for (; i < count; ++i) to[i] = static_cast<float>(from[i]);
}

/// One channel as floats between its margins, every stride-th column side by side:
/// scratch[row][phase][column].
inline void spread(const DepthwiseJob& job, const std::int8_t* in) {
  const int step = job.stride;
  const auto pitch = static_cast<int>(job.scratch_pitch);
  const int last = job.scratch_rows - job.pad_y < job.height ? job.scratch_rows - job.pad_y : job.height;
  for (int phase = 0; phase < step; ++phase) {
    // Column c holds the picture's column c * step + phase - pad.
    const int shift = job.pad_x - phase;
    const int first = shift > 0 ? (shift + step - 1) / step : 0;
    const int reach = (job.width + shift + step - 1) / step;
    const int count = (reach < pitch ? reach : pitch) - first;
    for (int y = 0; y < last; ++y) {
      float* to = job.scratch + static_cast<std::ptrdiff_t>((y + job.pad_y) * step + phase) * pitch + first;
      const std::int8_t* from = in + static_cast<std::ptrdiff_t>(y) * job.width + first * step - shift;
      if (step == 1) {
        widen(from, count, to);
      } else if (step == 2) {
        for (int c = 0; c < count; ++c) to[c] = static_cast<float>(from[c * 2]);
      } else {
        for (int c = 0; c < count; ++c) to[c] = static_cast<float>(from[c * step]);
      }
    }
  }
}

/// How far each weight's value lies from the first, in scratch.
struct Offsets {
  std::ptrdiff_t of[kMostTaps];
  explicit Offsets(const DepthwiseJob& job) {
    const auto pitch = static_cast<std::ptrdiff_t>(job.scratch_pitch);
    for (int tap = 0; tap < job.kernel_width * job.kernel_height; ++tap) {
      const int kx = tap % job.kernel_width, ky = tap / job.kernel_width;
      of[tap] = (ky * job.stride + kx % job.stride) * pitch + kx / job.stride;
    }
  }
};

/// The sums of kLanes columns in kDepthwiseRows rows, any kernel; `corner` is the first value that they see.
inline void sum_any(const DepthwiseJob& job, const Offsets& offsets, const float* weights,
                    const float* corner, Real* sums) {
  const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(job.scratch_pitch) * job.stride * job.stride;
  Real acc[kDepthwiseRows] = {};
  for (int tap = 0; tap < job.kernel_width * job.kernel_height; ++tap) {
    const float* from = corner + offsets.of[tap];
#pragma GCC unroll 4
    for (int r = 0; r < kDepthwiseRows; ++r)
      acc[r] += weights[tap] * *reinterpret_cast<const Loose*>(from + r * row);
  }
  for (int r = 0; r < kDepthwiseRows; ++r) sums[r] = acc[r];
}

/// The same for the usual kernels: each value is loaded once for all rows that it counts in.
template <int kSize, int kStep>
inline void sum_square(const Real* weights, const float* corner, std::ptrdiff_t pitch, Real* sums) {
  Real acc[kDepthwiseRows] = {};
#pragma GCC unroll 16
  for (int row = 0; row < (kDepthwiseRows - 1) * kStep + kSize; ++row) {
#pragma GCC unroll 8
    for (int kx = 0; kx < kSize; ++kx) {
      const Real value =
          *reinterpret_cast<const Loose*>(corner + (row * kStep + kx % kStep) * pitch + kx / kStep);
#pragma GCC unroll 4
      for (int r = 0; r < kDepthwiseRows; ++r) {
        const int ky = row - r * kStep;
        // cppcheck-suppress incorrectLogicOperator ; it tries a kSize of 0, for which strip() takes sum_any
        if (ky >= 0 && ky < kSize) acc[r] += weights[ky * kSize + kx] * value;
      }
    }
  }
  for (int r = 0; r < kDepthwiseRows; ++r) sums[r] = acc[r];
}

/// The rows from `y` on of one channel into out[kDepthwiseRows][columns], before the activation.
template <int kSize, int kStep>
inline void strip(const DepthwiseJob& job, const Offsets& offsets, int channel, int y, int columns,
                  std::int8_t* out) {
  const float* weights =
      job.weights + static_cast<std::ptrdiff_t>(channel) * job.kernel_width * job.kernel_height;
  const float multiplier = job.after.multiplier[channel];
  const auto pitch = static_cast<std::ptrdiff_t>(job.scratch_pitch);
  const float* left = job.scratch + static_cast<std::ptrdiff_t>(y) * job.stride * job.stride * pitch;
  Real spread_weights[kSize * kSize + 1];
  for (int i = 0; i < kSize * kSize; ++i) spread_weights[i] = Real{} + weights[i];
  for (int x = 0; x < columns; x += kLanes) {
    Real sums[kDepthwiseRows];
    if constexpr (kSize > 0) {
      sum_square<kSize, kStep>(spread_weights, left + x, pitch, sums);
    } else {
      sum_any(job, offsets, weights, left + x, sums);
    }
    Whole whole[kDepthwiseRows];
    Bytes narrowed[kDepthwiseRows];
    for (int r = 0; r < kDepthwiseRows; ++r)
      whole[r] = __builtin_convertvector(sums[r], Whole) + job.after.bias[channel];
    narrow(whole, multiplier, job.after.zero, narrowed);
    for (int r = 0; r < kDepthwiseRows; ++r) *reinterpret_cast<Bytes*>(out + r * columns + x) = narrowed[r];
  }
}

/// A byte in each of a word's four.
constexpr std::int32_t four_of(int byte) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(byte) * 0x01010101u);
}

#if defined(__AVX512VNNI__)

using Word = std::uint32_t __attribute__((vector_size(4 * kLanes)));

/// One channel between its margins as words of four rows: scratch[row][phase][column] holds the bytes of that
/// row and the three below it, 128 more each, so that a kernel's column is one product of four. In margins it
/// stays as it was filled.
template <int kStep>
inline void stack(const DepthwiseJob& job, const std::int8_t* in, int rows) {
  auto* words = reinterpret_cast<std::int32_t*>(job.scratch);
  const auto pitch = static_cast<int>(job.scratch_pitch);
  const auto shifted = [](Whole values) { return reinterpret_cast<Word>(values + 128) << 24; };
  for (int phase = 0; phase < kStep; ++phase) {
    const int shift = job.pad_x - phase, first = shift > 0 ? (shift + kStep - 1) / kStep : 0;
    const int reach = (job.width + shift + kStep - 1) / kStep, end = reach < pitch ? reach : pitch;
    for (int c = first; c < end; c += kLanes) {
      const int count = end - c < kLanes ? end - c : kLanes;
      const auto lanes = static_cast<__mmask16>((1u << count) - 1);
      const auto bytes = static_cast<__mmask32>((1u << (kStep * (count - 1) + 1)) - 1);
      const std::int8_t* from = in + c * kStep - shift;
      std::int32_t* to = words + phase * pitch + c;
      Word word = Word{} + static_cast<std::uint32_t>(four_of(job.in_zero + 128));
      for (int y = -3; y < rows; ++y) {
        const int from_y = y + 3 - job.pad_y;
        Word lowest = shifted(Whole{} + job.in_zero);
        if (from_y >= 0 && from_y < job.height) {
          const __m256i row =
              _mm256_maskz_loadu_epi8(bytes, from + static_cast<std::ptrdiff_t>(from_y) * job.width);
          const __m128i values =
              kStep == 1 ? _mm256_castsi256_si128(row) : _mm256_maskz_cvtepi16_epi8(0xffff, row);
          lowest = shifted(__builtin_convertvector(reinterpret_cast<Bytes>(values), Whole));
        }
        word = word >> 8 | lowest;
        if (y < 0) continue;
        _mm512_mask_storeu_epi32(to + static_cast<std::ptrdiff_t>(y) * kStep * pitch, lanes,
                                 reinterpret_cast<__m512i>(word));
      }
    }
  }
}

/// As strip(), from words of four rows.
template <int kSize, int kStep>
inline void strip_of_words(const DepthwiseJob& job, int channel, int y, int columns, std::int8_t* out) {
  constexpr int kStacks = (kSize + 3) / 4;
  const float* weights = job.weights + static_cast<std::ptrdiff_t>(channel) * kSize * kSize;
  __m512i products[kStacks][kSize];
  int start = job.after.bias[channel];
  for (int kx = 0; kx < kSize; ++kx) {
    std::uint32_t word[kStacks] = {};
    for (int ky = 0; ky < kSize; ++ky) {
      const int weight = static_cast<int>(weights[ky * kSize + kx]);
      start -= 128 * weight;
      word[ky / 4] |= (static_cast<std::uint32_t>(weight) & 255) << 8 * (ky % 4);
    }
    for (int i = 0; i < kStacks; ++i) products[i][kx] = _mm512_set1_epi32(static_cast<int>(word[i]));
  }
  const auto pitch = static_cast<std::ptrdiff_t>(job.scratch_pitch);
  const auto* left = reinterpret_cast<const std::int32_t*>(job.scratch) + y * kStep * kStep * pitch;
  for (int x = 0; x < columns; x += kLanes) {
    for (int r = 0; r < kDepthwiseRows; ++r) {
      __m512i sum = _mm512_set1_epi32(start);
#pragma GCC unroll 16
      for (int tap = 0; tap < kStacks * kSize; ++tap) {
        // cppcheck-suppress zerodiv ; as above, depthwise_of() calls this for a kSize above 0 only
        const int kx = tap % kSize, row = r * kStep + 4 * (tap / kSize);
        const __m512i stacked =
            _mm512_loadu_si512(left + x + (row * kStep + kx % kStep) * pitch + kx / kStep);
        // cppcheck-suppress zerodiv
        sum = _mm512_dpbusd_epi32(sum, stacked, products[tap / kSize][kx]);
      }
      *reinterpret_cast<Bytes*>(out + r * columns + x) =
          narrow(reinterpret_cast<Whole>(sum), job.after.multiplier[channel], job.after.zero);
    }
  }
}

constexpr bool kStacked = true;
#else
constexpr bool kStacked = false;
template <int kStep>
void stack(const DepthwiseJob& job, const std::int8_t* in, int rows);
template <int kSize, int kStep>
void strip_of_words(const DepthwiseJob& job, int channel, int y, int columns, std::int8_t* out);
#endif

template <int kSize, int kStep>
void depthwise_of(const DepthwiseJob& job) {
  const int columns = (job.out_width + kDepthwiseColumns - 1) / kDepthwiseColumns * kDepthwiseColumns;
  const Offsets offsets(job);
  const std::size_t floats = job.scratch_pitch * static_cast<std::size_t>(job.scratch_rows * job.stride);
  std::int8_t* bytes = reinterpret_cast<std::int8_t*>(job.scratch + floats);
  constexpr bool kWords = kStacked && kSize > 0;
  const Whole around = Whole{} + (kWords ? four_of(job.in_zero + 128)
                                         : __builtin_bit_cast(std::int32_t, static_cast<float>(job.in_zero)));
  for (std::size_t i = 0; i < floats; i += kLanes) *reinterpret_cast<Whole*>(job.scratch + i) = around;
  for (int c = 0; c < job.channels; ++c) {
    const std::int8_t* in = job.in + static_cast<std::ptrdiff_t>(c) * job.width * job.height;
    if constexpr (kWords) {
      stack<kStep>(job, in, job.scratch_rows + 1 - kSize + (kSize - 1) / 4 * 4);
    } else {
      spread(job, in);
    }
    std::int8_t* out = job.out + static_cast<std::ptrdiff_t>(c) * job.out_width * job.out_height;
    for (int y = 0; y < job.out_height; y += kDepthwiseRows) {
      if constexpr (kWords) {
        strip_of_words<kSize, kStep>(job, c, y, columns, bytes);
      } else {
        strip<kSize, kStep>(job, offsets, c, y, columns, bytes);
      }
      if (job.after.lut != nullptr) {
        for (int i = 0; i < kDepthwiseRows * columns; i += kDenseBlock) look_up(bytes + i, job.after.lut);
      }
      for (int r = 0; r < kDepthwiseRows && y + r < job.out_height; ++r) {
        __builtin_memcpy(out + static_cast<std::ptrdiff_t>(y + r) * job.out_width, bytes + r * columns,
                         static_cast<std::size_t>(job.out_width));
      }
    }
  }
}

void depthwise(const DepthwiseJob& job) {
  const bool square = kManyRegisters && job.kernel_width == job.kernel_height;
  const int size = square ? job.kernel_width : 0;
  if (size == 3 && job.stride == 1) {
    depthwise_of<3, 1>(job);
  } else if (size == 3 && job.stride == 2) {
    depthwise_of<3, 2>(job);
  } else if (size == 5 && job.stride == 1) {
    depthwise_of<5, 1>(job);
  } else if (size == 5 && job.stride == 2) {
    depthwise_of<5, 2>(job);
  } else {
    depthwise_of<0, 1>(job);
  }
}

}  // namespace

const Int8Kernels kernels{STILLMAP_ISA_NAME, kPerLane, kTile, kInputOffset, dense, depthwise};

}  // namespace stillmap::STILLMAP_ISA
