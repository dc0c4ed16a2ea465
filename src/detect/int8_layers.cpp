// SPDX-License-Identifier: Apache-2.0
#include "detect/int8_layers.h"

#include <algorithm>

namespace stillmap {

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
          for (int x = std::max((shift + stride - 1) / stride, 0); x < end; ++x)
            out[x] = std::max(out[x], row[x * stride - shift]);
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
      const std::int8_t *near = row(y / 2), *far = row(y % 2 == 0 ? y / 2 - 1 : y / 2 + 1);
      const auto above = [&](int x) { return 3 * near[x] + far[x]; };  // in quarters
      const auto level = [](int sixteenths) { return static_cast<std::int8_t>(sixteenths / 16); };
      for (int x = 0; x < shape.width; ++x) {
        const int here = 3 * above(x);
        out[2 * x] = level(here + above(std::max(x - 1, 0)));
        out[2 * x + 1] = level(here + above(std::min(x + 1, shape.width - 1)));
      }
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
