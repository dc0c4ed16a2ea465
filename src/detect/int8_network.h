// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "detect/int8_convolution.h"
#include "detect/int8_layers.h"
#include "detect/network.h"
#include "detect/onnx_file.h"
#include "detect/picture_scaler.h"

namespace stillmap {

/// A network of 8-bit layers alone, as scripts/quantize_model.py writes it: QuantizeLinear of the picture,
/// QLinearConv with or without QLinearLeakyRelu behind, QLinearAdd, QLinearConcat, MaxPool, Resize and Slice
/// of channels, and DequantizeLinear of the outputs. To the byte what OpenCV 4.6 makes of it, but for ties
/// that its convolutions round otherwise. All memory is taken at construction; tensors that are not needed at
/// once share theirs.
class Int8Network final : public Network {
 public:
  /// Errors: the first thing in the file that is none of the above.
  static Result<std::unique_ptr<Network>> open(const OnnxFile& file, const Letterbox& letterbox,
                                               const InputFormat& format);

  Status run(ImageView<const Bgr> colour) override;
  std::size_t output_count() const override { return chosen_.size(); }
  Tensor output(std::size_t i) const override;
  void choose_outputs(std::span<const std::size_t> chosen) override;

 private:
  friend class Int8NetworkBuilder;

  /// A tensor: where it begins in memory_, once that is laid out.
  struct Value {
    TensorShape shape;
    float scale = 1;
    int zero = 0;
    std::size_t storage = 0;  // which piece of memory
    std::size_t offset = 0;   // bytes from the piece's begin
  };
  struct Step {
    std::vector<std::size_t> inputs;  // values
    std::size_t output = 0;
    std::variant<Int8Convolution, MaxPool, Doubling, Sum, Join> layer;
  };
  struct Output {
    std::string name;
    std::size_t value = 0;
    std::vector<float> level, numbers;  // what each of the 256 values means; the tensor
  };

  Int8Network(const Letterbox& letterbox, const InputFormat& format);
  std::int8_t* place(std::size_t value) { return memory_.data() + place_[value]; }
  void fill_input(ImageView<const Bgr> colour);
  void lay_out();

  Letterbox letterbox_;
  InputFormat format_;
  PictureScaler scaler_;
  std::vector<Bgr> row_;
  std::array<std::array<std::int8_t, 256>, 3> quantized_{};  // by plane and grey level
  std::vector<Value> values_;                                // the first is the input
  std::vector<Step> steps_;
  std::vector<Output> outputs_;
  std::vector<std::size_t> chosen_;  // of outputs_
  std::vector<std::size_t> place_;   // of values_ in memory_
  std::vector<std::int8_t> memory_;
  std::vector<std::byte> scratch_;
};

}  // namespace stillmap
