// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace stillmap::test {

/// Writes an ONNX file of convolutions side by side on one input [1, 3, height, width], without any library.
class TinyOnnx {
 public:
  TinyOnnx(int height, int width);
  /// An output of `planes` planes that sees non-overlapping squares of `stride` px: plane p is
  /// bias[p] + weight[3 p + c] * (mean of channel c in the square).
  /// With `shape` it is reshaped to that.
  void add_output(const std::string& name, int planes, int stride, const std::vector<float>& bias,
                  const std::vector<float>& weight, const std::vector<int>& shape = {});
  std::string bytes() const;

 private:
  int height_, width_;
  std::string nodes_, initializers_, outputs_;
};

}  // namespace stillmap::test
