// SPDX-License-Identifier: Apache-2.0
#pragma once
// What differs between instruction sets, for int8_kernels.cpp alone: like that, compiled once for each of
// them.

#include "detect/int8_kernels.h"

#if defined(__SSE2__)
#include <immintrin.h>
#elif defined(__ARM_NEON)
#include <arm_neon.h>
#endif

namespace stillmap::STILLMAP_ISA {

/// Values in a vector; vectors of columns, and output channels, whose sums are held at once; see Int8Kernels.
#if defined(__AVX512VNNI__)
inline constexpr int kLanes = 16, kWide = 4, kTile = 6, kPerLane = 4, kInputOffset = 128;
#elif defined(__AVX2__)
inline constexpr int kLanes = 8, kWide = 2, kTile = 6, kPerLane = 2, kInputOffset = 0;
#elif defined(__aarch64__)
inline constexpr int kLanes = 4, kWide = 4, kTile = 4, kPerLane = 4, kInputOffset = 0;
#elif defined(__ARM_NEON)
inline constexpr int kLanes = 4, kWide = 2, kTile = 4, kPerLane = 4, kInputOffset = 0;
#else
inline constexpr int kLanes = 4, kWide = 2, kTile = 4, kPerLane = 2, kInputOffset = 0;
#endif
#if defined(__SSE2__) && !defined(__AVX2__)
inline constexpr bool kManyRegisters = false;  // a kernel's weights would go to memory and back
#else
inline constexpr bool kManyRegisters = true;
#endif
/// Whether two products are added as 16 bits, which those of -128 with itself do not fit.
#if defined(__ARM_NEON) && !defined(__ARM_FEATURE_DOTPROD)
inline constexpr bool kAddsIn16Bits = true;
#else
inline constexpr bool kAddsIn16Bits = false;
#endif
using Whole = std::int32_t __attribute__((vector_size(4 * kLanes), may_alias));
using Real = float __attribute__((vector_size(4 * kLanes)));
using Bytes = std::int8_t __attribute__((vector_size(kLanes), may_alias));
// As typedefs: of an alias Clang does not heed the alignment.
typedef float Loose __attribute__((vector_size(4 * kLanes), aligned(4), may_alias));
typedef std::int8_t LooseBytes __attribute__((vector_size(kLanes), aligned(1), may_alias));
using Sums = Whole[kTile][kWide];

#if defined(__ARM_NEON)

#if defined(__aarch64__)
inline int16x8_t products_high(int8x16_t a, int8x16_t b) {
  return vmull_high_s8(a, b);
}
inline int16x8_t add_products_high(int16x8_t sum, int8x16_t a, int8x16_t b) {
  return vmlal_high_s8(sum, a, b);
}
inline int16x8_t narrow_both(int32x4_t low, int32x4_t high) {
  return vqmovn_high_s32(vqmovn_s32(low), high);
}
inline int8x16_t narrow_both(int16x8_t low, int16x8_t high) {
  return vqmovn_high_s16(vqmovn_s16(low), high);
}
inline int32x4_t nearest(float32x4_t value) {
  return vcvtnq_s32_f32(value);
}
inline int8x16_t pair_of(int16x8_t weights, int pair) {
  return vreinterpretq_s8_s16(vdupq_laneq_s16(weights, pair));
}
#else
inline int16x8_t products_high(int8x16_t a, int8x16_t b) {
  return vmull_s8(vget_high_s8(a), vget_high_s8(b));
}
inline int16x8_t add_products_high(int16x8_t sum, int8x16_t a, int8x16_t b) {
  return vmlal_s8(sum, vget_high_s8(a), vget_high_s8(b));
}
inline int16x8_t narrow_both(int32x4_t low, int32x4_t high) {
  return vcombine_s16(vqmovn_s32(low), vqmovn_s32(high));
}
inline int8x16_t narrow_both(int16x8_t low, int16x8_t high) {
  return vcombine_s8(vqmovn_s16(low), vqmovn_s16(high));
}
inline int32x4_t nearest(float32x4_t value) {
  return vcvtq_s32_f32(vrndnq_f32(value));
}
inline int8x16_t pair_of(int16x8_t weights, int pair) {
  return vreinterpretq_s8_s16(pair < 4 ? vdupq_lane_s16(vget_low_s16(weights), pair % 4)
                                       : vdupq_lane_s16(vget_high_s16(weights), pair % 4));
}
#endif

/// kDenseBlock columns of the channels of one lane.
inline void interleave(const std::int8_t* const (&from)[kPerLane], std::int8_t* to) {
  for (int x = 0; x < kDenseBlock; x += 16, to += 64) {
    const int8x16_t a = vld1q_s8(from[0] + x), b = vld1q_s8(from[1] + x);
    const int8x16_t c = vld1q_s8(from[2] + x), d = vld1q_s8(from[3] + x);
#if defined(__ARM_FEATURE_DOTPROD)
    vst4q_s8(to, (int8x16x4_t{{a, b, c, d}}));  // side by side
#else
    // By eight columns the first two channels, then the others.
    const int8x16x2_t ab = vzipq_s8(a, b), cd = vzipq_s8(c, d);
    for (int half = 0; half < 2; ++half) {
      vst1q_s8(to + 32 * half, ab.val[half]);
      vst1q_s8(to + 32 * half + 16, cd.val[half]);
    }
#endif
  }
}

/// Adds the products of the channels of one lane; `whole_range` where a weight may be -128.
template <bool whole_range>
inline void multiply_lane(const std::int32_t* x, const std::int32_t* w, Sums& sums) {
#if defined(__ARM_FEATURE_DOTPROD)
  const int8x16_t weights = vreinterpretq_s8_s32(vld1q_s32(w));
#pragma GCC unroll 8
  for (int v = 0; v < kWide; ++v) {
    const int8x16_t inputs = vreinterpretq_s8_s32(vld1q_s32(x + kLanes * v));
    sums[0][v] = (Whole)vdotq_laneq_s32((int32x4_t)sums[0][v], inputs, weights, 0);
    sums[1][v] = (Whole)vdotq_laneq_s32((int32x4_t)sums[1][v], inputs, weights, 1);
    sums[2][v] = (Whole)vdotq_laneq_s32((int32x4_t)sums[2][v], inputs, weights, 2);
    sums[3][v] = (Whole)vdotq_laneq_s32((int32x4_t)sums[3][v], inputs, weights, 3);
  }
#else
  int16x8_t pairs = vreinterpretq_s16_s32(vld1q_s32(w));
  asm("" : "+w"(pairs));  // loaded once; GCC would load each pair, and to where it must be moved from
#pragma GCC unroll 8
  for (int o = 0; o < kTile; ++o) {
    const int8x16_t first = pair_of(pairs, 2 * o), second = pair_of(pairs, 2 * o + 1);
#pragma GCC unroll 8
    for (int v = 0; v < kWide; v += 2) {
      const int8x16_t a = vreinterpretq_s8_s32(vld1q_s32(x + kLanes * v));
      const int8x16_t b = vreinterpretq_s8_s32(vld1q_s32(x + kLanes * (v + 1)));
      const int16x8_t low = vmull_s8(vget_low_s8(a), vget_low_s8(first)), high = products_high(a, first);
      const auto add = [&](Whole& sum, int16x8_t products) {
        sum = (Whole)vpadalq_s16((int32x4_t)sum, products);
      };
      if constexpr (whole_range) {
        add(sums[o][v], low);
        add(sums[o][v + 1], high);
        add(sums[o][v], vmull_s8(vget_low_s8(b), vget_low_s8(second)));
        add(sums[o][v + 1], products_high(b, second));
      } else {
        add(sums[o][v], vmlal_s8(low, vget_low_s8(b), vget_low_s8(second)));
        add(sums[o][v + 1], add_products_high(high, b, second));
      }
    }
  }
#endif
}

/// Four vectors of sums, requantized but for the activation.
inline void narrow(const Whole (&sums)[4], float multiplier, int zero, Bytes (&out)[4]) {
  const auto rounded = [&](const Whole& sum) {
    return nearest(vmulq_n_f32(vcvtq_f32_s32((int32x4_t)sum), multiplier));
  };
  const int16x8_t zeros = vdupq_n_s16(static_cast<std::int16_t>(zero));
  const int16x8_t low = vqaddq_s16(narrow_both(rounded(sums[0]), rounded(sums[1])), zeros);
  const int16x8_t high = vqaddq_s16(narrow_both(rounded(sums[2]), rounded(sums[3])), zeros);
  const int8x16_t bytes = narrow_both(low, high);
  __builtin_memcpy(out, &bytes, sizeof bytes);
}

/// kWidened values as floats.
inline constexpr int kWidened = 8;
inline void widen_vector(const std::int8_t* from, float* to) {
  const int16x8_t values = vmovl_s8(vld1_s8(from));
  vst1q_f32(to, vcvtq_f32_s32(vmovl_s16(vget_low_s16(values))));
  vst1q_f32(to + 4, vcvtq_f32_s32(vmovl_s16(vget_high_s16(values))));
}

#else

/// kDenseBlock columns of the channels of one lane, side by side.
inline void interleave(const std::int8_t* const (&from)[kPerLane], void* to) {
#if defined(__AVX512VNNI__)
  using Value = std::uint8_t;
#else
  using Value = std::int16_t;
#endif
  Value* values = static_cast<Value*>(to);
  for (int x = 0; x < kDenseBlock; ++x) {
    for (int i = 0; i < kPerLane; ++i)
      values[kPerLane * x + i] = static_cast<Value>(from[i][x] + kInputOffset);
  }
}

/// Sums of products of the kPerLane channels in each lane.
inline Whole dot(Whole sum, Whole x, Whole w) {
#if defined(__AVX512VNNI__)
  return reinterpret_cast<Whole>(_mm512_dpbusd_epi32(
      reinterpret_cast<__m512i>(sum), reinterpret_cast<__m512i>(x), reinterpret_cast<__m512i>(w)));
#elif defined(__AVX2__)
  return sum + reinterpret_cast<Whole>(
                   _mm256_madd_epi16(reinterpret_cast<__m256i>(x), reinterpret_cast<__m256i>(w)));
#elif defined(__SSE2__)
  return sum +
         reinterpret_cast<Whole>(_mm_madd_epi16(reinterpret_cast<__m128i>(x), reinterpret_cast<__m128i>(w)));
#else
  // The upper half's weight, then the lower half's with its sign.
  return sum + (x >> 16) * (w >> 16) + ((x << 16) >> 16) * ((w << 16) >> 16);
#endif
}

/// Adds the products of the channels of one lane.
template <bool whole_range>
inline void multiply_lane(const std::int32_t* x, const std::int32_t* w, Sums& sums) {
  const Whole* from = reinterpret_cast<const Whole*>(x);
#pragma GCC unroll 8
  for (int o = 0; o < kTile; ++o) {
    const Whole weight = Whole{} + w[o];
#pragma GCC unroll 8
    for (int v = 0; v < kWide; ++v) sums[o][v] = dot(sums[o][v], from[v], weight);
  }
}

/// kWidened values as floats.
inline constexpr int kWidened = kLanes;
inline void widen_vector(const std::int8_t* from, float* to) {
  *reinterpret_cast<Loose*>(to) = __builtin_convertvector(*reinterpret_cast<const LooseBytes*>(from), Real);
}

/// Sums, requantized but for the activation.
inline Bytes narrow(Whole sum, float multiplier, int zero) {
  constexpr float kRound = 12582912;  // adding 1.5 * 2^23 rounds, to even, to a whole number
  const float low = static_cast<float>(-128 - zero), high = static_cast<float>(127 - zero);
  Real value = __builtin_convertvector(sum, Real) * multiplier;
  value = value < low ? Real{} + low : value;
  value = value > high ? Real{} + high : value;
  return __builtin_convertvector(reinterpret_cast<Whole>(value + kRound) - 0x4B400000 + zero, Bytes);
}
inline void narrow(const Whole (&sums)[4], float multiplier, int zero, Bytes (&out)[4]) {
#pragma GCC unroll 4
  for (int i = 0; i < 4; ++i) out[i] = narrow(sums[i], multiplier, zero);
}

#endif

/// The activation of kDenseBlock values.
inline void look_up(std::int8_t* values, const std::int8_t* lut) {
#if defined(__AVX512VBMI__)
  const __m512i index = _mm512_xor_si512(_mm512_loadu_si512(values), _mm512_set1_epi8(-128));
  const auto table = [&](int part) { return _mm512_loadu_si512(lut + 64 * part); };
  const __m512i low = _mm512_permutex2var_epi8(table(0), index, table(1));
  const __m512i high = _mm512_permutex2var_epi8(table(2), index, table(3));
  _mm512_storeu_si512(values, _mm512_mask_blend_epi8(_mm512_movepi8_mask(index), low, high));
#elif defined(__aarch64__)
  int8x16x4_t quarters[4];
  for (int q = 0; q < 4; ++q) quarters[q] = vld1q_s8_x4(lut + 64 * q);
  for (int i = 0; i < kDenseBlock; i += 16) {
    // Each quarter knows 64 places, and leaves what lies beyond as it is.
    const uint8x16_t place = veorq_u8(vreinterpretq_u8_s8(vld1q_s8(values + i)), vdupq_n_u8(128));
    int8x16_t found = vqtbl4q_s8(quarters[0], place);
    for (int q = 1; q < 4; ++q)
      found = vqtbx4q_s8(found, quarters[q], veorq_u8(place, vdupq_n_u8(static_cast<std::uint8_t>(64 * q))));
    vst1q_s8(values + i, found);
  }
#else
  for (int i = 0; i < kDenseBlock; ++i) values[i] = lut[values[i] + 128];
#endif
}

}  // namespace stillmap::STILLMAP_ISA
