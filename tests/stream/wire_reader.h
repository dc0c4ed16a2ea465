// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <cstring>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace stillmap::test {

/// The fields of one protobuf message, by number, read straight from the bytes: each value as its raw bytes
/// (varints as 8 bytes). Independent of nanopb, which wrote them.
class WireMessage {
 public:
  explicit WireMessage(std::span<const std::uint8_t> bytes) {
    while (!bytes.empty()) {
      const std::uint64_t key = varint(bytes);
      const std::uint64_t type = key & 7;
      std::uint64_t size = type == 1 ? 8 : type == 5 ? 4 : 0, value = 0;
      if (type == 0) value = varint(bytes);
      if (type == 2) size = varint(bytes);
      if (size > bytes.size() || (type != 0 && size == 0 && type != 2)) {
        broken_ = true;
        return;
      }
      std::vector<std::uint8_t> raw(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
      if (type == 0) {
        raw.resize(8);
        std::memcpy(raw.data(), &value, 8);
      }
      fields_[static_cast<int>(key >> 3)].push_back(raw);
      bytes = bytes.subspan(static_cast<std::size_t>(size));
    }
  }

  bool broken() const { return broken_; }
  std::size_t count(int field) const { return fields_.contains(field) ? fields_.at(field).size() : 0; }
  /// Proto3 leaves zeros out, so a missing number is 0.
  template <class T>
  T number(int field) const {
    T value{};
    if (count(field) > 0) std::memcpy(&value, fields_.at(field)[0].data(), sizeof(T));
    return value;
  }
  std::string text(int field) const {
    return count(field) == 0 ? "" : std::string(fields_.at(field)[0].begin(), fields_.at(field)[0].end());
  }
  WireMessage message(int field, std::size_t index = 0) const {
    return WireMessage(fields_.at(field).at(index));
  }

 private:
  std::uint64_t varint(std::span<const std::uint8_t>& bytes) {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 64 && !bytes.empty(); shift += 7) {
      const std::uint64_t byte = bytes[0];
      bytes = bytes.subspan(1);
      value |= (byte & 127) << shift;
      if (byte < 128) return value;
    }
    broken_ = true;
    return 0;
  }

  std::map<int, std::vector<std::vector<std::uint8_t>>> fields_;
  bool broken_ = false;
};

}  // namespace stillmap::test
