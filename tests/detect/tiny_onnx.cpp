// SPDX-License-Identifier: Apache-2.0
#include "tests/detect/tiny_onnx.h"

namespace stillmap::test {

namespace {

// Protocol buffers by hand; field numbers are those of onnx.proto.
std::string varint(std::uint64_t v) {
  std::string out;
  for (; v >= 128; v >>= 7) out += static_cast<char>((v & 127) | 128);
  return out + static_cast<char>(v);
}
std::string number(unsigned field, std::uint64_t v) {
  return varint(field << 3) + varint(v);
}
std::string bytes_field(unsigned field, const std::string& v) {
  return varint(field << 3 | 2) + varint(v.size()) + v;
}

std::string tensor(const std::string& name, const std::vector<int>& dims, const std::vector<float>& values) {
  std::string out;
  for (const int d : dims) out += number(1, static_cast<std::uint64_t>(d));
  const std::string raw(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
  return out + number(2, 1) + bytes_field(8, name) + bytes_field(9, raw);
}

std::string int64_tensor(const std::string& name, const std::vector<int>& values) {
  const std::vector<std::int64_t> wide(values.begin(), values.end());
  const std::string raw(reinterpret_cast<const char*>(wide.data()), wide.size() * sizeof(std::int64_t));
  return number(1, wide.size()) + number(2, 7) + bytes_field(8, name) + bytes_field(9, raw);
}

std::string value_info(const std::string& name, const std::vector<int>& dims) {
  std::string shape;
  for (const int d : dims) shape += bytes_field(1, number(1, static_cast<std::uint64_t>(d)));
  return bytes_field(1, name) + bytes_field(2, bytes_field(1, number(1, 1) + bytes_field(2, shape)));
}

std::string ints_attribute(const std::string& name, const std::vector<int>& values) {
  std::string out = bytes_field(1, name);
  for (const int v : values) out += number(8, static_cast<std::uint64_t>(v));
  return out + number(20, 7);
}

}  // namespace

TinyOnnx::TinyOnnx(int height, int width) : height_(height), width_(width) {}

void TinyOnnx::add_output(const std::string& name, int planes, int stride, const std::vector<float>& bias,
                          const std::vector<float>& weight, const std::vector<int>& shape) {
  const int square = stride * stride;
  std::vector<float> kernel;
  for (const float w : weight)
    kernel.insert(kernel.end(), static_cast<std::size_t>(square), w / static_cast<float>(square));
  initializers_ += bytes_field(5, tensor(name + "_w", {planes, 3, stride, stride}, kernel));
  initializers_ += bytes_field(5, tensor(name + "_b", {planes}, bias));
  const std::string map = shape.empty() ? name : name + "_map";
  nodes_ +=
      bytes_field(1, bytes_field(1, "data") + bytes_field(1, name + "_w") + bytes_field(1, name + "_b") +
                         bytes_field(2, map) + bytes_field(3, map) + bytes_field(4, "Conv") +
                         bytes_field(5, ints_attribute("kernel_shape", {stride, stride})) +
                         bytes_field(5, ints_attribute("strides", {stride, stride})));
  if (shape.empty()) {
    outputs_ += bytes_field(12, value_info(name, {1, planes, height_ / stride, width_ / stride}));
    return;
  }
  initializers_ += bytes_field(5, int64_tensor(name + "_shape", shape));
  nodes_ += bytes_field(1, bytes_field(1, map) + bytes_field(1, name + "_shape") + bytes_field(2, name) +
                               bytes_field(3, name) + bytes_field(4, "Reshape"));
  outputs_ += bytes_field(12, value_info(name, shape));
}

std::string TinyOnnx::bytes() const {
  const std::string graph = nodes_ + bytes_field(2, "tiny") + initializers_ +
                            bytes_field(11, value_info("data", {1, 3, height_, width_})) + outputs_;
  return number(1, 7) + bytes_field(7, graph) + bytes_field(8, number(2, 11));
}

}  // namespace stillmap::test
