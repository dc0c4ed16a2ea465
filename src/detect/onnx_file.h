// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap {

/// A constant of an ONNX file.
struct OnnxTensor {
  enum Type : int { Float = 1, Int8 = 3, Int32 = 6, Int64 = 7 };
  int type = 0;
  std::vector<std::int64_t> shape;  ///< empty: one number
  std::vector<double> numbers;      ///< exact; empty for a type that is not named above
};

struct OnnxAttribute {
  double number = 0;  ///< of a float or an integer
  std::string text;
  std::vector<std::int64_t> list;
};

struct OnnxNode {
  std::string name, domain, kind;
  std::vector<std::string> inputs, outputs;
  std::map<std::string, OnnxAttribute, std::less<>> attributes;
};

/// What is read of an ONNX file: the graph, without what the format has beyond inference of plain networks.
struct OnnxFile {
  std::vector<OnnxNode> nodes;  ///< each after those that it needs
  std::map<std::string, OnnxTensor, std::less<>> constants;
  std::vector<std::string> inputs, outputs;  ///< names; inputs may be constants' too
};

/// Reads the protobuf of onnx.proto3. Nothing where the bytes are no such message.
std::optional<OnnxFile> read_onnx(std::span<const std::byte> bytes);

}  // namespace stillmap
