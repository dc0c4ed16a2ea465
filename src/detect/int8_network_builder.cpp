// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <map>

#include "detect/int8_network.h"

namespace stillmap {

namespace {

std::int8_t cut(long value) {
  return static_cast<std::int8_t>(std::clamp(value, -128L, 127L));
}

/// A constant of one number; the type says whether it is a scale or a zero point.
std::optional<double> scalar(const OnnxFile& file, std::string_view name, int type) {
  const auto found = file.constants.find(name);
  if (found == file.constants.end()) return std::nullopt;
  const OnnxTensor& tensor = found->second;
  if (tensor.type != type || tensor.numbers.size() != 1) return std::nullopt;
  return tensor.numbers[0];
}

struct Quantization {
  float scale = 1;
  int zero = 0;
  bool operator==(const Quantization&) const = default;
};

/// The scale and zero point that a node names as its inputs `at` and `at + 1`.
std::optional<Quantization> quantization(const OnnxFile& file, const OnnxNode& node, std::size_t at) {
  if (node.inputs.size() <= at + 1) return std::nullopt;
  const auto scale = scalar(file, node.inputs[at], OnnxTensor::Float);
  const auto zero = scalar(file, node.inputs[at + 1], OnnxTensor::Int8);
  if (!scale || !zero || !(*scale > 0)) return std::nullopt;
  return Quantization{static_cast<float>(*scale), static_cast<int>(*zero)};
}

/// Squares of one size, moved by one stride, with the same margin on all sides.
struct Window {
  int width = 1, height = 1, stride = 1, pad_x = 0, pad_y = 0;
};

std::optional<Window> window(const OnnxNode& node) {
  const auto numbers = [&](const char* name, std::size_t count, std::int64_t otherwise) {
    const auto found = node.attributes.find(name);
    std::vector<std::int64_t> list(count, otherwise);
    if (found != node.attributes.end()) list = found->second.list;
    for (std::int64_t& n : list) n = std::clamp<std::int64_t>(n, -1, 1 << 16);
    list.resize(count, -1);  // a number that fits nothing
    return list;
  };
  const auto size = numbers("kernel_shape", 2, -1), strides = numbers("strides", 2, 1),
             pads = numbers("pads", 4, 0), dilations = numbers("dilations", 2, 1);
  const auto padding = node.attributes.find("auto_pad"), ceil = node.attributes.find("ceil_mode");
  if ((padding != node.attributes.end() && padding->second.text != "NOTSET") ||
      (ceil != node.attributes.end() && ceil->second.number != 0) ||
      dilations != std::vector<std::int64_t>{1, 1} || strides[0] != strides[1] || pads[0] != pads[2] ||
      pads[1] != pads[3] || size[0] < 1 || size[1] < 1 || strides[0] < 1 || pads[0] < 0 || pads[1] < 0 ||
      pads[0] >= size[0] || pads[1] >= size[1])
    return std::nullopt;
  return Window{static_cast<int>(size[1]), static_cast<int>(size[0]), static_cast<int>(strides[0]),
                static_cast<int>(pads[1]), static_cast<int>(pads[0])};
}

template <class T>
std::vector<T> numbers_of(const OnnxTensor& tensor) {
  std::vector<T> numbers(tensor.numbers.size());
  std::ranges::transform(tensor.numbers, numbers.begin(), [](double n) { return static_cast<T>(n); });
  return numbers;
}

}  // namespace

/// Makes the steps of a network from the nodes of a file. Each `add_` says whether it could.
class Int8NetworkBuilder {
 public:
  Int8NetworkBuilder(const OnnxFile& file, Int8Network& network) : file_(file), net_(network) {}

  /// The node that cannot be run; null where all can.
  const OnnxNode* build() {
    for (const OnnxNode& node : file_.nodes) {
      for (const std::string& input : node.inputs) ++uses_[input];
    }
    for (const OnnxNode& node : file_.nodes) {
      if (node.outputs.size() != 1 || node.inputs.empty() || !add(node)) return &node;
    }
    return nullptr;
  }
  /// Whether the file's outputs are what DequantizeLinear gave.
  bool gives_all_outputs() const {
    return !net_.outputs_.empty() && net_.outputs_.size() == file_.outputs.size() &&
           std::ranges::all_of(net_.outputs_, [&](const Int8Network::Output& output) {
             return std::ranges::find(file_.outputs, output.name) != file_.outputs.end();
           });
  }

 private:
  using Value = Int8Network::Value;

  bool add(const OnnxNode& node) {
    if (node.kind == "QuantizeLinear") return add_input(node);
    const auto input = values_.find(node.inputs[node.kind == "QLinearConcat" ? 2 % node.inputs.size() : 0]);
    if (input == values_.end()) return false;
    if (node.kind == "QLinearConv") return add_convolution(node, input->second);
    if (node.kind == "QLinearLeakyRelu") return add_activation(node, input->second);
    if (node.kind == "QLinearAdd") return add_sum(node, input->second);
    if (node.kind == "QLinearConcat") return add_join(node);
    if (node.kind == "MaxPool") return add_pool(node, input->second);
    if (node.kind == "Resize") return add_doubling(node, input->second);
    if (node.kind == "Slice") return add_slice(node, input->second);
    return node.kind == "DequantizeLinear" && add_output(node, input->second);
  }

  std::size_t new_value(const OnnxNode& node, const TensorShape& shape, const Quantization& q) {
    const std::size_t value = net_.values_.size();
    net_.values_.push_back({shape, q.scale, q.zero, value, 0});
    values_[node.outputs[0]] = value;
    return value;
  }
  Quantization of(std::size_t value) const { return {net_.values_[value].scale, net_.values_[value].zero}; }
  const TensorShape& shape(std::size_t value) const { return net_.values_[value].shape; }

  bool add_input(const OnnxNode& node) {
    const auto q = quantization(file_, node, 1);
    if (!q || !net_.values_.empty() || std::ranges::find(file_.inputs, node.inputs[0]) == file_.inputs.end())
      return false;
    new_value(node, {3, net_.letterbox_.input_height, net_.letterbox_.input_width}, *q);
    for (std::size_t plane = 0; plane < 3; ++plane) {
      for (int v = 0; v < 256; ++v) {
        const float x = net_.format_.normalised(net_.format_.channel_of(plane), v);
        net_.quantized_[plane][static_cast<std::size_t>(v)] =
            cut(std::lrintf(std::fma(x, 1.f / q->scale, static_cast<float>(q->zero))));
      }
    }
    return true;
  }

  bool add_convolution(const OnnxNode& node, std::size_t input) {
    const auto from = quantization(file_, node, 1), to = quantization(file_, node, 6);
    const auto frame = window(node);
    const OnnxTensor *weights = constant(node, 3, OnnxTensor::Int8),
                     *scales = constant(node, 4, OnnxTensor::Float),
                     *zeros = constant(node, 5, OnnxTensor::Int8);
    if (!from || !to || !frame || weights == nullptr || scales == nullptr || zeros == nullptr ||
        weights->shape.size() != 4 || weights->shape[0] < 1 || weights->shape[0] > 65536 ||
        std::ranges::any_of(zeros->numbers, [](double z) { return z != 0; }))
      return false;
    const auto group = node.attributes.find("group");
    const double groups = group == node.attributes.end() ? 1 : group->second.number;
    const std::size_t outputs = static_cast<std::size_t>(weights->shape[0]), size = weights->numbers.size();
    const Int8Convolution::Shape form{shape(input).channels, static_cast<int>(weights->shape[0]),
                                      frame->width,          frame->height,
                                      frame->stride,         frame->pad_x,
                                      frame->pad_y,          groups > 1};
    const int seen = form.depthwise ? 1 : form.in_channels;  // channels, by each output
    if ((form.depthwise && groups != form.in_channels) || !Int8Convolution::can(form) ||
        weights->shape[1] != seen || weights->shape[2] != frame->height ||
        weights->shape[3] != frame->width ||
        size != outputs * static_cast<std::size_t>(seen * frame->width * frame->height) ||
        (scales->numbers.size() != 1 && scales->numbers.size() != outputs))
      return false;
    std::vector<std::int32_t> bias(outputs);
    if (node.inputs.size() > 8) {
      const OnnxTensor* given = constant(node, 8, OnnxTensor::Int32);
      if (given == nullptr || given->numbers.size() != outputs) return false;
      bias = numbers_of<std::int32_t>(*given);
    }
    const std::vector<std::int8_t> w = numbers_of<std::int8_t>(*weights);
    std::vector<float> multiplier(outputs);
    for (std::size_t o = 0; o < outputs; ++o) {
      int sum = 0;
      for (std::size_t i = o * (size / outputs); i < (o + 1) * (size / outputs); ++i) sum += w[i];
      bias[o] -= from->zero * sum;
      const auto scale = static_cast<float>(scales->numbers[scales->numbers.size() == 1 ? 0 : o]);
      multiplier[o] = from->scale * scale / to->scale;
    }
    Int8Convolution layer(*int8_kernels().front(), form, w, bias, multiplier, from->zero, to->zero);
    const TensorShape& in = shape(input);
    const TensorShape out{form.out_channels, layer.out_height(in.height), layer.out_width(in.width)};
    return out.height > 0 && out.width > 0 && add_step(node, {input}, out, *to, std::move(layer));
  }

  /// Becomes part of the convolution before it.
  bool add_activation(const OnnxNode& node, std::size_t input) {
    const auto from = quantization(file_, node, 1), to = quantization(file_, node, 3);
    const auto step = std::ranges::find(net_.steps_, input, &Int8Network::Step::output);
    if (!from || !to || step == net_.steps_.end() || uses_[node.inputs[0]] != 1) return false;
    auto* convolution = std::get_if<Int8Convolution>(&step->layer);
    if (convolution == nullptr || convolution->has_lut()) return false;
    const auto alpha = node.attributes.find("alpha");
    const auto slope = static_cast<float>(alpha == node.attributes.end() ? 0.01 : alpha->second.number);
    std::array<std::int8_t, 256> lut{};
    for (int i = -128; i < 128; ++i) {
      const float x = from->scale * static_cast<float>(i - from->zero);
      const float y = x >= 0 ? x : slope * x;
      lut[static_cast<std::size_t>(i + 128)] = cut(to->zero + std::lrintf(y / to->scale));
    }
    convolution->set_lut(lut);
    net_.values_[input].scale = to->scale;
    net_.values_[input].zero = to->zero;
    values_[node.outputs[0]] = input;
    return true;
  }

  bool add_sum(const OnnxNode& node, std::size_t a) {
    const auto of_a = quantization(file_, node, 1), of_b = quantization(file_, node, 4),
               to = quantization(file_, node, 6);
    if (!of_a || !of_b || !to) return false;
    const auto b = values_.find(node.inputs[3]);
    if (b == values_.end() || shape(b->second) != shape(a)) return false;
    Sum layer{of_a->scale / to->scale, of_b->scale / to->scale, static_cast<float>(to->zero)};
    layer.offset -=
        layer.a_factor * static_cast<float>(of_a->zero) + layer.b_factor * static_cast<float>(of_b->zero);
    return add_step(node, {a, b->second}, shape(a), *to, layer);
  }

  bool add_join(const OnnxNode& node) {
    const auto to = quantization(file_, node, 0);
    const auto axis = node.attributes.find("axis");
    if (!to || node.inputs.size() % 3 != 2 || axis == node.attributes.end() || axis->second.number != 1)
      return false;
    std::vector<std::size_t> parts;
    TensorShape whole;
    for (std::size_t i = 2; i < node.inputs.size(); i += 3) {
      const auto part = values_.find(node.inputs[i]);
      if (part == values_.end() || quantization(file_, node, i + 1) != to) return false;
      const TensorShape& s = shape(part->second);
      if (!parts.empty() && (s.height != whole.height || s.width != whole.width)) return false;
      whole = {whole.channels + s.channels, s.height, s.width};
      parts.push_back(part->second);
    }
    return !parts.empty() && add_step(node, std::move(parts), whole, *to, Join{});
  }

  bool add_pool(const OnnxNode& node, std::size_t input) {
    const auto frame = window(node);
    if (!frame || frame->width != frame->height || frame->pad_x != frame->pad_y) return false;
    const MaxPool layer{frame->width, frame->stride, frame->pad_x};
    const TensorShape out = layer.shape_of(shape(input));
    return out.height > 0 && out.width > 0 && add_step(node, {input}, out, of(input), layer);
  }

  bool add_doubling(const OnnxNode& node, std::size_t input) {
    const auto text = [&](const char* name) {
      const auto found = node.attributes.find(name);
      return found == node.attributes.end() ? std::string() : found->second.text;
    };
    const OnnxTensor* scales = constant(node, 2, OnnxTensor::Float);
    if (scales == nullptr || scales->numbers != std::vector<double>{1, 1, 2, 2} || node.inputs.size() > 3 ||
        text("mode") != "linear" || text("coordinate_transformation_mode") != "pytorch_half_pixel")
      return false;
    return add_step(node, {input}, Doubling::shape_of(shape(input)), of(input), Doubling{});
  }

  /// A view of some channels.
  bool add_slice(const OnnxNode& node, std::size_t input) {
    const auto number = [&](std::size_t at) {
      return node.inputs.size() > at ? scalar(file_, node.inputs[at], OnnxTensor::Int64) : std::nullopt;
    };
    const auto begin = number(1), end = number(2), axis = number(3);
    if (!begin || !end || axis != 1 || node.inputs.size() > 4) return false;
    const TensorShape& in = shape(input);
    const double last = std::min(*end, static_cast<double>(in.channels));
    if (*begin < 0 || *begin >= last) return false;
    Value part = net_.values_[input];
    part.shape.channels = static_cast<int>(last - *begin);
    part.offset += static_cast<std::size_t>(*begin) * in.plane();
    values_[node.outputs[0]] = net_.values_.size();
    net_.values_.push_back(part);
    return true;
  }

  bool add_output(const OnnxNode& node, std::size_t input) {
    const auto q = quantization(file_, node, 1);
    if (!q) return false;
    Int8Network::Output output{node.outputs[0], input, std::vector<float>(256),
                               std::vector<float>(shape(input).size())};
    const float offset = -(q->scale * static_cast<float>(q->zero));
    for (int i = 0; i < 256; ++i)
      output.level[static_cast<std::size_t>(i)] = std::fma(static_cast<float>(i - 128), q->scale, offset);
    net_.outputs_.push_back(std::move(output));
    return true;
  }

  template <class Layer>
  bool add_step(const OnnxNode& node, std::vector<std::size_t> inputs, const TensorShape& out,
                const Quantization& q, Layer layer) {
    const std::size_t value = new_value(node, out, q);
    net_.steps_.push_back({std::move(inputs), value, std::move(layer)});
    return true;
  }

  const OnnxTensor* constant(const OnnxNode& node, std::size_t at, int type) const {
    if (node.inputs.size() <= at) return nullptr;
    const auto found = file_.constants.find(node.inputs[at]);
    const bool usable = found != file_.constants.end() && found->second.type == type;
    return usable ? &found->second : nullptr;
  }

  const OnnxFile& file_;
  Int8Network& net_;
  std::map<std::string, std::size_t, std::less<>> values_;  // by name
  std::map<std::string, int, std::less<>> uses_;
};

Result<std::unique_ptr<Network>> Int8Network::open(const OnnxFile& file, const Letterbox& letterbox,
                                                   const InputFormat& format) {
  std::unique_ptr<Int8Network> network(new Int8Network(letterbox, format));
  Int8NetworkBuilder builder(file, *network);
  if (const OnnxNode* node = builder.build(); node != nullptr)
    return Error{ExitCode::UnreadableInput,
                 "'" + node->name + "' is a " + node->kind + " that no layer of ours is"};
  if (!builder.gives_all_outputs()) return Error{ExitCode::UnreadableInput, "not all outputs are quantized"};
  network->chosen_.resize(network->outputs_.size());
  for (std::size_t i = 0; i < network->chosen_.size(); ++i) network->chosen_[i] = i;
  network->lay_out();
  return std::unique_ptr<Network>(std::move(network));
}

}  // namespace stillmap
