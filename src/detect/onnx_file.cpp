// SPDX-License-Identifier: Apache-2.0
#include "detect/onnx_file.h"

#include <bit>
#include <cstring>

namespace stillmap {

namespace {

using Bytes = std::span<const std::byte>;

/// One field of a protobuf message.
struct Field {
  int number = 0;
  std::uint64_t value = 0;  // a varint, or the bits of a fixed number
  Bytes bytes;              // of a length-delimited field
  bool is_bytes = false;

  std::string text() const { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }
  std::int64_t integer() const { return static_cast<std::int64_t>(value); }
};

/// The fields of a message one after the other. A message that breaks off or that no encoder writes ends
/// early and is not `sound`.
class Message {
 public:
  explicit Message(Bytes bytes) : rest_(bytes) {}

  std::optional<Field> next() {
    if (rest_.empty() || !sound_) return std::nullopt;
    const std::uint64_t tag = varint();
    Field field;
    field.number = static_cast<int>(tag >> 3);
    switch (tag & 7) {
      case 0:
        field.value = varint();
        break;
      case 1:
        field.value = fixed(8);
        break;
      case 2:
        field.bytes = take(varint());
        field.is_bytes = true;
        break;
      case 5:
        field.value = fixed(4);
        break;
      default:
        sound_ = false;
    }
    if (!sound_) return std::nullopt;
    return field;
  }
  std::uint64_t varint() {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 64; shift += 7) {
      const Bytes byte = take(1);
      if (byte.empty()) return 0;
      value |= (static_cast<std::uint64_t>(byte[0]) & 0x7f) << shift;
      if ((static_cast<unsigned>(byte[0]) & 0x80) == 0) return value;
    }
    sound_ = false;
    return 0;
  }
  bool done() const { return rest_.empty() || !sound_; }
  bool sound() const { return sound_; }

 private:
  Bytes take(std::uint64_t count) {
    if (count > rest_.size()) {
      sound_ = false;
      return {};
    }
    const Bytes taken = rest_.first(static_cast<std::size_t>(count));
    rest_ = rest_.subspan(taken.size());
    return taken;
  }
  std::uint64_t fixed(std::size_t size) {
    static_assert(std::endian::native == std::endian::little);
    std::uint64_t value = 0;
    const Bytes bytes = take(size);
    std::memcpy(&value, bytes.data(), bytes.size());
    return value;
  }

  Bytes rest_;
  bool sound_ = true;
};

template <class T>
void append_raw(Bytes raw, std::vector<double>& numbers) {
  numbers.reserve(raw.size() / sizeof(T));
  for (std::size_t i = 0; i + sizeof(T) <= raw.size(); i += sizeof(T)) {
    T value;
    std::memcpy(&value, raw.data() + i, sizeof(T));
    numbers.push_back(static_cast<double>(value));
  }
}

/// A repeated integer, packed or one by one.
template <class T>
bool append_integers(const Field& field, std::vector<T>& to) {
  if (!field.is_bytes) {
    to.push_back(static_cast<T>(field.integer()));
    return true;
  }
  Message packed(field.bytes);
  while (!packed.done()) to.push_back(static_cast<T>(static_cast<std::int64_t>(packed.varint())));
  return packed.sound();
}

bool read_tensor(Bytes bytes, std::string& name, OnnxTensor& tensor) {
  Message message(bytes);
  Bytes raw, floats;
  while (const auto field = message.next()) {
    if (field->number == 1 && !append_integers(*field, tensor.shape)) return false;
    if (field->number == 2) tensor.type = static_cast<int>(field->value);
    if (field->number == 4 && field->is_bytes) floats = field->bytes;
    if ((field->number == 5 || field->number == 7) && !append_integers(*field, tensor.numbers)) return false;
    if (field->number == 8) name = field->text();
    if (field->number == 9) raw = field->bytes;
  }
  if (tensor.type == OnnxTensor::Float) append_raw<float>(raw.empty() ? floats : raw, tensor.numbers);
  if (tensor.type == OnnxTensor::Int8) append_raw<std::int8_t>(raw, tensor.numbers);
  if (tensor.type == OnnxTensor::Int32) append_raw<std::int32_t>(raw, tensor.numbers);
  if (tensor.type == OnnxTensor::Int64) append_raw<std::int64_t>(raw, tensor.numbers);
  return message.sound();
}

bool read_attribute(Bytes bytes, OnnxNode& node) {
  Message message(bytes);
  std::string name;
  OnnxAttribute attribute;
  while (const auto field = message.next()) {
    if (field->number == 1) name = field->text();
    if (field->number == 2) attribute.number = std::bit_cast<float>(static_cast<std::uint32_t>(field->value));
    if (field->number == 3) attribute.number = static_cast<double>(field->integer());
    if (field->number == 4) attribute.text = field->text();
    if (field->number == 8 && !append_integers(*field, attribute.list)) return false;
  }
  node.attributes[name] = std::move(attribute);
  return message.sound();
}

bool read_node(Bytes bytes, OnnxNode& node) {
  Message message(bytes);
  while (const auto field = message.next()) {
    if (field->number == 1) node.inputs.push_back(field->text());
    if (field->number == 2) node.outputs.push_back(field->text());
    if (field->number == 3) node.name = field->text();
    if (field->number == 4) node.kind = field->text();
    if (field->number == 5 && !read_attribute(field->bytes, node)) return false;
    if (field->number == 7) node.domain = field->text();
  }
  return message.sound();
}

/// The name that a description of an input or output begins with.
bool read_name(Bytes bytes, std::vector<std::string>& names) {
  Message message(bytes);
  while (const auto field = message.next()) {
    if (field->number == 1) names.push_back(field->text());
  }
  return message.sound();
}

bool read_graph(Bytes bytes, OnnxFile& file) {
  Message message(bytes);
  bool sound = true;
  while (const auto field = message.next()) {
    if (field->number == 1) sound &= read_node(field->bytes, file.nodes.emplace_back());
    if (field->number == 5) {
      std::string name;
      OnnxTensor tensor;
      sound &= read_tensor(field->bytes, name, tensor);
      file.constants[name] = std::move(tensor);
    }
    if (field->number == 11) sound &= read_name(field->bytes, file.inputs);
    if (field->number == 12) sound &= read_name(field->bytes, file.outputs);
  }
  return sound && message.sound();
}

}  // namespace

std::optional<OnnxFile> read_onnx(std::span<const std::byte> bytes) {
  Message message(bytes);
  OnnxFile file;
  bool has_graph = false;
  while (const auto field = message.next()) {
    if (field->number != 7) continue;
    if (!read_graph(field->bytes, file)) return std::nullopt;
    has_graph = true;
  }
  if (!has_graph || !message.sound()) return std::nullopt;
  return file;
}

}  // namespace stillmap
