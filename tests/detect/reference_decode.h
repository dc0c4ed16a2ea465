// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/fixed_vector.h"
#include "detect/decoder.h"

namespace stillmap::test {

constexpr int kPictureWidth = 640, kPictureHeight = 480, kInputWidth = 320, kInputHeight = 256;
constexpr double kScore = 0.35, kIou = 0.6;

inline DecoderSetup decoder_setup(int classes, std::vector<int> strides) {
  return {classes, kInputWidth, kInputHeight, std::move(strides), kScore};
}

/// What a decoder, after choose() of these same tensors (checked), makes of them.
FixedVector<Detection, 64> decode(Decoder& decoder, int classes, std::span<const Tensor> outputs,
                                  double nms_iou = kIou);

/// Expects of decode() what reference_decode.py says of `family`'s outputs, at least ten boxes. Skips where
/// there is no Python with numpy.
void expect_as_reference(const std::string& family, Decoder& decoder, int classes,
                         std::span<const Tensor> outputs);

/// A tensor over `values`, which it does not own.
Tensor tensor_of(std::string_view name, std::initializer_list<std::size_t> shape,
                 std::span<const float> values);

}  // namespace stillmap::test
