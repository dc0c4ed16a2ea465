// SPDX-License-Identifier: Apache-2.0
#include "detect/int8_layers.h"

#include <algorithm>

#include "core/vector_clones.h"

namespace stillmap {

namespace {

/// out[i] = the larger of it and from[i * step].
STILLMAP_VECTOR_CLONES void take_larger(const std::int8_t* from, int step, int count, std::int8_t* out) {
  if (step == 2) {
    for (int i = 0; i < count; ++i) out[i] = std::max(out[i], from[2 * i]);
  } else {
    for (int i = 0; i < count; ++i) out[i] = std::max(out[i], from[i * step]);
  }
}

/// A row of twice the width, between the row at three quarters of the weight and the one at a quarter.
STILLMAP_VECTOR_CLONES void double_row(const std::int8_t* near, const std::int8_t* far, int width,
                                       std::int8_t* out) {
  const auto above = [=](int x) { return 3 * near[x] + far[x]; };  // in quarters
  const auto level = [](int sixteenths) { return static_cast<std::int8_t>(sixteenths / 16); };
  out[0] = level(4 * above(0));
  for (int x = 0; x + 1 < width; ++x) {
    const int left = above(x), right = above(x + 1);
    out[2 * x + 1] = level(3 * left + right);
    out[2 * x + 2] = level(left + 3 * right);
  }
  out[2 * width - 1] = level(4 * above(width - 1));
}

}  // namespace

void MaxPool::run(const TensorShape& shape, const std::int8_t* in, std::int8_t* out) const {
  const TensorShape to = shape_of(shape);
  for (int c = 0; c < shape.channels; ++c, in += shape.plane()) {
    for (int y = 0; y < to.height; ++y, out += to.width) {
      std::fill_n(out, to.width, std::int8_t{-128});
      const int y0 = std::max(y * stride - pad, 0), y1 = std::min(y * stride - pad + size, shape.height);
      for (int from_y = y0; from_y < y1; ++from_y) {
        const std::int8_t* row = in + static_cast<std::ptrdiff_t>(from_y) * shape.width;
        for (int k = 0; k < size; ++k) {
          // Output columns from `first` to `end` see the picture with this column of the square.
          const int shift = pad - k;
          const int end = std::clamp((shape.width + shift + stride - 1) / stride, 0, to.width);
          const int first = std::max((shift + stride - 1) / stride, 0);
          if (first < end) take_larger(row + first * stride - shift, stride, end - first, out + first);
        }
      }
    }
  }
}

void Doubling::run(const TensorShape& shape, const std::int8_t* in, std::int8_t* out) {
  for (int c = 0; c < shape.channels; ++c, in += shape.plane()) {
    for (int y = 0; y < 2 * shape.height; ++y, out += 2 * shape.width) {
      const auto row = [&](int at) {
        return in + std::ptrdiff_t{std::clamp(at, 0, shape.height - 1)} * shape.width;
      };
      double_row(row(y / 2), row(y % 2 == 0 ? y / 2 - 1 : y / 2 + 1), shape.width, out);
    }
  }
}

void Sum::run(std::size_t count, const std::int8_t* a, const std::int8_t* b, std::int8_t* out) const {
  for (std::size_t i = 0; i < count; ++i) {
    const float sum = a_factor * static_cast<float>(a[i]) + b_factor * static_cast<float>(b[i]) + offset;
    const int whole = static_cast<int>(sum);
    const float rest = sum - static_cast<float>(whole);
    out[i] = static_cast<std::int8_t>(
        std::clamp(whole + (rest >= 0.5f ? 1 : 0) - (rest <= -0.5f ? 1 : 0), -128, 127));
  }
}

}  // namespace stillmap
